"""Whether errors are told as they are, and kept to what was asked for."""
