"""Simulations: a cloth stepped along with its bones, one or many, alone or with steps chosen on the way."""
