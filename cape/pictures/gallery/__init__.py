"""A page of pictures: what there is to wear, in motion."""
