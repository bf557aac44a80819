"""Solids that cloth can't enter, each on a bone or standing still in the world."""

from skeleton.shapes import Box, Capsule, Cylinder, Ellipsoid, Plane, Shape, Sphere, TaperedCapsule

Collider = Shape

__all__ = ["Box", "Capsule", "Collider", "Cylinder", "Ellipsoid", "Plane", "Sphere", "TaperedCapsule"]
