"""Compiled inner loops: plain arrays in, plain arrays out, numba and numpy alone."""
