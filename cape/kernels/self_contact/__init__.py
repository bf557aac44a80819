"""Contact of a cloth with itself."""
