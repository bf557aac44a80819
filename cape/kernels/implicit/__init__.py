"""Implicit steps, and the equations that are solved in them."""
