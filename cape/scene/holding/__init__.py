"""What holds a cloth: bones, springs and curves, and how far it may get from where they carry it."""
