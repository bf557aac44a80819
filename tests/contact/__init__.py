"""Tests of contact, with whole solvers."""
