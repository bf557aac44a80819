"""Files of recordings: complete or absent, through a pipe that tells of a full disk."""
