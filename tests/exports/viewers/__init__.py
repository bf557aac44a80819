"""Exports as other programs show them."""
