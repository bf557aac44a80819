"""What becomes of a cloth between limbs, from frame to frame."""
