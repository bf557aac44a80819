"""Tests of the compiler, and of what is kept of its work."""
