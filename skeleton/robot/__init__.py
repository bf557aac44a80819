"""Robots: their links' surfaces, hitboxes around those, and files of motions and of solids."""
