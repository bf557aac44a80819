"""The air around a cloth: how fast it is, where, and when. `wind` is what a scene is given."""
