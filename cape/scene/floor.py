"""The floor under a motion, which motion files do not tell."""

from collections.abc import Sequence

import numpy as np

from cape.scene.colliders import Collider, Plane
from skeleton.placed_solids import floor_level
from skeleton.track import BoneTrack


def floor_under(colliders: Sequence[Collider], track: BoneTrack) -> Plane:
    """Find the level floor that a body of colliders stands on over a motion; at z = 0 where there is none.

    It lies at the lowest point of all that bones carry in all frames but the lowest 2 %.
    """
    level = floor_level(colliders, track)
    return Plane(name="floor", point=np.array([0.0, 0.0, 0.0 if level is None else level]))
