"""Tests of skeleton/."""
