"""What a character may wear: a file for each kind of garment, cut to a body's measures."""
