"""Scenes with names, to look at: the figures of the report that this project grew from, and others worth showing."""
