"""The meshes of a robot's links: found, or stood in for, and read."""
