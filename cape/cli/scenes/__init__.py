"""Scene files: what the command line can say, and more, as text to keep."""
