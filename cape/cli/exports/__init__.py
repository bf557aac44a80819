"""Kept takes and exports at the command line."""
