"""Compiled code of a cloth that tears."""
