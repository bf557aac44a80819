"""Cloth whose pieces are of different fabrics."""
