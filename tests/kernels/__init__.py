"""Tests of kernels on plain arrays."""
