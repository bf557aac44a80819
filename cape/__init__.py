"""Cloth on moving bones."""
