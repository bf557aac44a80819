"""Tests of motions/."""
