"""Levels above a cloth for the multigrid preconditioner: how vertices are gathered, and the arrays of that."""
