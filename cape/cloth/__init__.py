"""Pieces of cloth: how they are cut, of what fabric."""
