"""The floor under a motion, which motion files do not tell."""

from collections.abc import Sequence

import numpy as np

from cape.colliders import Collider, Plane
from motions import quaternions
from skeleton.shapes import Capsule
from skeleton.track import BoneTrack

RARE = 0.02  # share of frames that may go below: a foot that sinks in once does not lower the floor


def floor_under(colliders: Sequence[Collider], track: BoneTrack) -> Plane:
    """Find the level floor that a body of capsules stands on over a motion; at z = 0 where there is none.

    It lies at the lowest point of all capsules in all frames but the lowest 2 %.
    """
    heights = []
    for capsule in colliders:
        if not isinstance(capsule, Capsule) or capsule.bone is None:
            continue
        bone = track.index(capsule.bone)
        for end in (capsule.start, capsule.end):
            turned = quaternions.rotate(track.rotations_wxyz[:, bone], np.broadcast_to(end, (track.frames, 3)))
            heights.append(track.positions[:, bone, 2] + turned[:, 2] - capsule.radius)
    level = float(np.quantile(np.min(heights, axis=0), RARE)) if heights else 0.0
    return Plane(name="floor", point=np.array([0.0, 0.0, level]))
