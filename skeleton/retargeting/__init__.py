"""A clip's motion on a robot."""
