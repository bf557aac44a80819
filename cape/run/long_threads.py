"""Threads that a limit of strain has left too long, as it does where steps are long for what limbs do to them."""

import numpy as np

from cape.assembly.assemble import Assembly
from cape.kernels.calling import Bound
from cape.kernels.cloth.measure import is_strained
from cape.kernels.state import State

LEFT = 0.01  # strain beyond their limit that sweeps over threads may leave


class LongThreads:
    """Looks for such threads in a cloth at a state, which may change in place."""

    def __init__(self, assembly: Assembly, state: State) -> None:
        """Choose the threads that are not held at both ends, of a scene that limits strain; of others none."""
        springs, free, fabric = assembly.springs, assembly.free, assembly.cloth.fabric
        self._limits = assembly.scene.strain_limit
        chosen = springs.measured & (free[springs.first] | free[springs.second])
        self._first, self._second, rest = springs.first[chosen], springs.second[chosen], springs.rest[chosen]
        most = float(max(fabric.limit_warp, fabric.limit_weft)) + LEFT
        self._longest = (1.0 + most) * rest
        self._state, self._colliders = state, assembly.contacts.colliders
        self._any = Bound(is_strained, *state[:3], self._first, self._second, rest, most)

    def found(self) -> bool:
        """Tell whether there is one that shorter steps may shorten: none of whose ends two limbs pinch."""
        if not self._limits or not self._any():
            return False
        if self._colliders is None:
            return True
        places = np.stack(self._state[:3], axis=1).astype(float)
        long = np.linalg.norm(places[self._second] - places[self._first], axis=1) > self._longest
        pinched = self._colliders.pinched
        return bool((long & ~pinched[self._first] & ~pinched[self._second]).any())
