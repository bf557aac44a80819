"""Tests of simulations and of what is read off them."""
