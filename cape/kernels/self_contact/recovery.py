"""How layers that are too close move apart, without any velocity.

Slowly, for where folds leave no room for the thickness springs push back what is moved apart: quickly done, that makes
a heap tremble. But those that pass through each other, or have, are put back at once, however they tremble: what lies
through a triangle at a frame's end is seen, and held there by all that is around it. That goes so far at a time only,
as Box2D bounds its corrections (Catto, b2_maxLinearCorrection): farther, they would pass what is beside them.
"""

from cape.kernels.jit import inlined

# Of the thickness: pairs that are too close by more than `DEEP` are about to pass, by more than `CORE` do, or have;
# these are put back by `AT_ONCE` in a beat at most. A limit of strain, which acts after layers are kept apart, does not
# take back as much as they have then.
DEEP, CORE, AT_ONCE = 0.5, 0.9, 0.3
# s in which others move apart by all but 1/e of what they lack, beyond `DEEP` and up to there.
RECOVERY, EASE = 20e-3, 0.3


@inlined
def moved_apart(depth, thickness, interval):
    """How far a pair that is too close by `depth` [m] is moved apart when `interval` [s] have passed since the last
    time [m]."""
    through = min(max(depth - CORE * thickness, 0.0), AT_ONCE * thickness)
    deep = max(depth - DEEP * thickness, 0.0)
    return through + (deep - through) * min(1.0, interval / RECOVERY) + (depth - deep) * min(1.0, interval / EASE)
