"""Textile tests on the simulated cloth, each held against a closed form, an ODE or a measurement."""
