"""Readers of mesh files: OBJ, PLY and GLB, each to a `Source`."""
