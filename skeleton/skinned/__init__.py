"""Characters with a mesh that their bones move."""
