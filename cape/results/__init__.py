"""What a simulation leaves behind, and what to look at in it."""
