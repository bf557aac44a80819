"""A character with its mesh, beside the cloth of an export."""
