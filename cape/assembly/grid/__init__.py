"""Grids as arrays: their springs, also where they have split."""
