"""Keeping pace with the clock: when steps are due, and what is given up where they take too long."""
