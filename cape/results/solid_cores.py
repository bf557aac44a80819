"""What lies deepest inside of a solid."""

from cape.scene.colliders import Collider
from skeleton.shapes import require_known

CORE = 0.1  # of a solid's inner radius: how far its core reaches


def core(solid: Collider) -> Collider | None:
    """What is deepest in a solid, one tenth of its inner radius around its middle; None for a half-space.

    Raises:
        UnknownNameError: the solid is of no shape in `skeleton.shapes.SHAPES`.
    """
    require_known((solid,))
    return solid.core(CORE)
