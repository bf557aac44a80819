"""Measurements of single solvers."""
