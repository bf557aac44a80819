"""Where limbs have gone through a cloth, from frame to frame: what of it is let slip off them.

A limb has gone through a triangle where the line in its middle, from its joint to its tip, meets that. No cloth that
was put on around a body lies so, but for what limbs have pinched between them. Looked at are only triangles with
threads that are too long, as those around a limb are.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from cape.assembly.assemble import Assembly
from cape.kernels.contact.slip import NOT
from cape.kernels.state import State
from cape.measure.wearing import ray_hits
from cape.scene.poses import Pose
from motions import quaternions
from skeleton.shapes import Bounded
from skeleton.solid_measures import signed_distance

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


class Slips:
    """What of a cloth at a state, which may change in place, slips off which limb.

    Attributes:
        of_vertices: the collider that each vertex slips off, `NOT` for none, as kernels read it, shape (N,).
    """

    def __init__(self, assembly: Assembly, state: State) -> None:
        """Note the limbs among a scene's colliders, none of whose cloth slips yet."""
        colliders, self._state = assembly.contacts.colliders, state
        self._free, self._triangles = assembly.free, assembly.cloth.triangles
        limbs, bones, cores, starts, ends = [], [], [], [], []
        if colliders is None:
            self.of_vertices, self._beyond = np.full(len(state.x), NOT), np.empty(0, np.int64)
        else:
            self.of_vertices, self._beyond = colliders.slips, colliders.beyond
            for c, shape in enumerate(assembly.scene.colliders):
                record = colliders.records[c]
                if isinstance(shape, Bounded) and record.tip.any():
                    middle, reach = shape.ball()
                    half = (reach - record.core) * (np.asarray(record.frame) @ record.tip)
                    limbs.append((c, shape))
                    bones.append(int(record.bone))
                    cores.append(float(record.core))
                    starts.append(middle - half)
                    ends.append(middle + half)
        self._limbs: list[tuple[int, Bounded]] = limbs
        self._names, self._bones = np.array([c for c, _ in limbs], np.int64), np.array(bones, np.int64)
        self._cores = np.array(cores)  # how far a limb's surface is from its middle line [m]
        self._lines = np.array([starts, ends]).reshape(2, -1, 3)  # of their middles, in their bones [m]

    def begin(self, long: NDArray[np.bool_], pose: Pose) -> bool:
        """Let what limbs have gone through slip; tells whether any does off a limb that nothing slipped off before."""
        if not long.any():
            return False
        found = self._find(long, pose)
        more = (found != NOT) & (found != self.of_vertices)
        anew = more & ~np.isin(found, self.of_vertices)
        self.of_vertices[more] = found[more]
        return bool(anew.any())

    def go_on(self, long: Callable[[], NDArray[np.bool_]], pose: Pose) -> None:
        """Let what slips off limbs go on as long as they are through it at a frame's end; `long` is asked only then."""
        if (self.of_vertices != NOT).any():
            self.of_vertices[:] = self._find(long(), pose)

    def _find(self, long: NDArray[np.bool_], pose: Pose) -> IntArray:
        """What slips, or is to, with the bones at a pose: a collider for each vertex, `NOT` for none, shape (N,).

        Corners of triangles that a limb goes through, of those with a vertex that is at the end of a thread that is too
        `long` (N,) or slips already; and what slips already as long as it is in the limb.
        """
        found = np.full_like(self.of_vertices, NOT)
        slipping = self.of_vertices != NOT
        places = np.stack(self._state[:3], axis=1).astype(float)
        turns, origins = pose.rotations_wxyz[self._bones], pose.positions[self._bones]
        if slipping.any():
            for k, (c, shape) in enumerate(self._limbs):
                own = np.flatnonzero((self.of_vertices == c) | (self._beyond[self.of_vertices] == c) & slipping)
                if len(own):
                    in_bone = quaternions.rotate(quaternions.conjugate(turns[k]), places[own] - origins[k])
                    own = own[signed_distance(shape, in_bone) < 0.0]
                    # In what comes first of two limbs that meet, it goes on as it did.
                    found[own[(found[own] == NOT) | (self.of_vertices[own] == c)]] = c
        chosen = self._triangles[(long | slipping)[self._triangles].any(axis=1)]
        begins, ends = origins + quaternions.rotate(turns, self._lines)
        limbs, rows = boxes_that_meet(np.stack([begins, ends], axis=1), places[chosen])
        ways = ends[limbs] - begins[limbs]
        lengths = np.linalg.norm(ways, axis=1)
        with np.errstate(invalid="ignore"):  # of a limb without length, which meets nothing
            hits = ray_hits(begins[limbs], ways / lengths[:, None], places[chosen[rows]][:, None])[:, 0]
        through = hits <= lengths
        found[chosen[rows[through]]] = self._names[limbs[through], None]
        found[~self._free] = NOT
        if (found != NOT).any():
            self._join(begins, ends)
        return found

    def _join(self, begins: FloatArray, ends: FloatArray) -> None:
        """Note which limb goes on where another one ends: the one that begins there, as a hand does in a wrist."""
        off = np.linalg.norm(ends[:, None] - begins, axis=2)
        off[(off > self._cores) | np.eye(len(off), dtype=bool)] = np.inf
        nearest = off.argmin(axis=1)
        joined = np.isfinite(off.min(axis=1))
        self._beyond[self._names] = np.where(joined, self._names[nearest], NOT)


def boxes_that_meet(one: FloatArray, other: FloatArray) -> tuple[IntArray, IntArray]:
    """Which of m sets of points (m, a, 3) have boxes that meet those of which of n (n, b, 3): in order, each (k,)."""
    (low, high), (least, most) = ((points.min(axis=1), points.max(axis=1)) for points in (one, other))
    meet = np.ones((len(one), len(other)), bool)
    for axis in range(3):
        meet &= (low[:, None, axis] <= most[:, axis]) & (least[:, axis] <= high[:, None, axis])
    first, second = np.nonzero(meet)
    return first, second
