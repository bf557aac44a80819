"""Clips joined into one: a graph of where they are alike, blends, and scripts."""
