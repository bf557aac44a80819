"""A running cloth that hands take hold of."""
