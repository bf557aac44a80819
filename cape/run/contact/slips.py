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
        self._limbs: list[tuple[int, int, Bounded, FloatArray, FloatArray]] = []
        if colliders is None:
            self.of_vertices = np.full(len(state.x), NOT)
            return
        self.of_vertices = colliders.slips
        for c, shape in enumerate(assembly.scene.colliders):
            record = colliders.records[c]
            if isinstance(shape, Bounded) and record.tip.any():
                middle, reach = shape.ball()
                half = (reach - record.core) * (np.asarray(record.frame) @ record.tip)
                self._limbs.append((c, int(record.bone), shape, middle - half, middle + half))

    def begin(self, long: NDArray[np.bool_], pose: Pose) -> bool:
        """Let what limbs have gone through slip, besides what does already; tells whether there is any such."""
        if not long.any():
            return False
        found = self._find(long, pose)
        more = (found != NOT) & (found != self.of_vertices)
        self.of_vertices[more] = found[more]
        return bool(more.any())

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
        chosen = self._triangles[(long | slipping)[self._triangles].any(axis=1)]
        places = np.stack(self._state[:3], axis=1).astype(float)
        corners = places[chosen]
        first = corners[:, 0]
        reach = np.sqrt(np.square(corners - first[:, None]).sum(axis=2).max(initial=0.0))
        for c, bone, shape, start, end in self._limbs:
            turn, origin = pose.rotations_wxyz[bone], pose.positions[bone]
            own = np.flatnonzero(self.of_vertices == c)
            if len(own):
                in_bone = quaternions.rotate(quaternions.conjugate(turn), places[own] - origin)
                found[own[signed_distance(shape, in_bone) < 0.0]] = c
            begins, ends = (origin + quaternions.rotate(turn, place) for place in (start, end))
            length = float(np.linalg.norm(ends - begins))
            if length == 0.0:
                continue
            # Their first corners lie in the box around the limb's middle line, but for what a triangle reaches.
            low, high = np.minimum(begins, ends) - reach, np.maximum(begins, ends) + reach
            near = np.flatnonzero((first[:, 2] >= low[2]) & (first[:, 2] <= high[2]))
            near = near[((first[near] >= low) & (first[near] <= high)).all(axis=1)]
            if len(near):
                ways = ray_hits(begins[None], (ends - begins)[None] / length, corners[near][None])[0]
                found[chosen[near[ways <= length]]] = c
        found[~self._free] = NOT
        return found
