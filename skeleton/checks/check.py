"""What deserves a look in a motion before anything is hung on it."""

import math
from collections.abc import Sequence

from motions.border import checked
from motions.errors import ValueRangeError
from skeleton.checks.crossings import crossings
from skeleton.checks.findings import Finding
from skeleton.checks.speeds import glitches, too_fast
from skeleton.checks.standing import feet, scale_doubts
from skeleton.placed_solids import as_capsules
from skeleton.shapes import Shape
from skeleton.track import BoneTrack


@checked
def check_motion(track: BoneTrack, solids: Sequence[Shape] = (), *, height: float | None = None) -> tuple[Finding, ...]:
    """Check a motion of any source: glitches, speeds beyond human limits, crossed limbs, feet and floor, scale.

    Args:
        track: poses of all bones, Z up. Without roles and parents less can be told.
        solids: around its limbs, of which boxes don't count; none for a check of the speeds alone.
        height: of the body [m], None where it is unknown or no human's.

    Returns:
        What was found, kind after kind, of each the worst first.

    Raises:
        UnknownNameError: a solid's bone isn't in the track.
        ValueRangeError: the height is none.
    """
    if height is not None and not 0.0 < height < math.inf:
        raise ValueRangeError(f"the height of the body must be positive, not {height}")
    capsules = as_capsules(solids)
    return (
        *glitches(track, capsules),
        *too_fast(track, capsules),
        *crossings(track, capsules),
        *feet(track, capsules),
        *scale_doubts(track, capsules, height=height),
    )
