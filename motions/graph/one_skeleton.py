"""Whether clips move one and the same skeleton."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from motions.clip import Clip
from motions.errors import ValueRangeError

TOLERANCE = 1e-3
"""By how much an offset may differ between two clips [m]: files round to a tenth of it, other bodies differ by more."""


def check_one_skeleton(clips: Sequence[Clip]) -> None:
    """Check that all clips have the first one's joints, parents, offsets and end sites.

    Raises:
        ValueRangeError: one differs; names the clip and what differs first.
    """
    for clip in clips[1:]:
        if difference := _difference(clips[0], clip):
            raise ValueRangeError(f"clip {clip.name!r} moves another skeleton than {clips[0].name!r}: {difference}")


def _difference(a: Clip, b: Clip) -> str | None:
    """What the second has, in words, where the first has something else."""
    if missing := [joint for joint in a.joints if joint not in b.joints]:
        return f"it lacks the joint {missing[0]!r}"
    if more := [joint for joint in b.joints if joint not in a.joints]:
        return f"it has a joint {more[0]!r} besides"
    if a.joints != b.joints:
        return "its joints come in another order"
    for joint, before, here in zip(a.joints, a.parents, b.parents, strict=True):
        if before != here:
            return f"{joint!r} hangs at {b.joints[here]!r}, not at {a.joints[before]!r}"
    if (far := _farthest(a.offsets, b.offsets)) is not None:
        return f"{b.joints[far[0]]!r} is {far[1]:.3f} m away from its place"
    if a.end_parents.tolist() != b.end_parents.tolist():
        return f"it has end sites at {_names(b)}, not at {_names(a)}"
    if (far := _farthest(a.end_offsets, b.end_offsets)) is not None:
        return f"the end site of {b.joints[b.end_parents[far[0]]]!r} is {far[1]:.3f} m away from its place"
    return None


def _farthest(a: NDArray[np.float64], b: NDArray[np.float64]) -> tuple[int, float] | None:
    """Which offset differs most, and by how much [m]; None where all agree."""
    apart = np.linalg.norm(a - b, axis=-1)
    worst = int(apart.argmax()) if len(apart) else 0
    return (worst, float(apart[worst])) if len(apart) and apart[worst] > TOLERANCE else None


def _names(clip: Clip) -> str:
    return ", ".join(clip.joints[joint] for joint in clip.end_parents) or "none"
