"""What lies deepest inside of a solid."""

from dataclasses import replace

from cape.scene.colliders import Box, Capsule, Collider, Plane, Sphere

CORE = 0.1  # of a solid's inner radius: how far its core reaches


def core(solid: Collider) -> Collider | None:
    """What is deepest in a solid, one tenth of its inner radius around its middle; None for a half-space."""
    if isinstance(solid, Plane):
        return None
    if isinstance(solid, Box):
        return replace(solid, half_sizes=solid.half_sizes - (1.0 - CORE) * solid.half_sizes.min())
    if isinstance(solid, Sphere | Capsule):
        return replace(solid, radius=CORE * solid.radius)
    return replace(solid, start_radius=CORE * solid.start_radius, end_radius=CORE * solid.end_radius)
