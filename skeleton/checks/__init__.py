"""What looks wrong in a motion."""
