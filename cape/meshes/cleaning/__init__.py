"""From a mesh as a file gives it to one that can be a cloth, or the reason why it can't."""
