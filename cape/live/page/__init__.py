"""A page on which cloth is taken in the hand."""
