"""Garments worn together, one over the other, that meet."""
