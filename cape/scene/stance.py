"""How a body stands: a cape that hangs from somebody who goes on all fours has less room than its wearer is tall."""

import numpy as np

from skeleton.track import BoneTrack

LEVEL = 0.5  # rise of a trunk per length of it, below which it is nearer to level than to upright
SHARE = 0.85  # of the room above the floor: a hem that swings is to stay above it


def room_on_all_fours(track: BoneTrack, floor: float) -> float | None:
    """Length [m] of a cape that stays above the floor; None for a body whose trunk is ever upright, or ever hangs.

    Args:
        track: the motion; None for one that tells nothing of both upper arms and both thighs.
        floor: height of the floor [m].
    """
    if not {f"{side}_{limb}" for side in ("left", "right") for limb in ("upper_arm", "thigh")} <= set(track.roles):
        return None
    arms, legs = (
        track.positions[:, [track.index(f"{side}_{limb}") for side in ("left", "right")]].mean(axis=1)
        for limb in ("upper_arm", "thigh")
    )
    trunk = arms - legs
    if (np.abs(trunk[:, 2]) > LEVEL * np.linalg.norm(trunk, axis=1)).any():
        return None
    return SHARE * float(np.median(arms[:, 2]) - floor)
