"""Tests of the physics, and of solvers."""
