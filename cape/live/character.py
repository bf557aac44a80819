"""A character that is steered while it wears a cloth."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cape.scene.poses import Pose
from motions import quaternions
from motions.clip import Clip
from motions.graph.motion_graph import MotionGraph
from motions.graph.walker import Walker
from skeleton.model import Skeleton

FloatArray = NDArray[np.float64]

TURNING = 2.0  # [rad/s] at which a character turns
MOST_TURN = np.pi  # [rad] that it has still to turn


class CharacterSource:
    """The bones of a character that passes from clip to clip as it is told.

    It begins to do so in the first frame after it was told.

    Attributes:
        skin: its mesh, None for none.
    """

    def __init__(self, clips: Sequence[Clip], body: Skeleton, start: str, *, once: Sequence[str] = ()) -> None:
        """Stand at the beginning of a clip.

        Args:
            clips: of the body.
            body: who moves.
            start: name of the clip to begin with, which goes round.
            once: names of clips that are played once.

        Raises:
            ValueRangeError: the clips are too short, or of different bodies.
            UnknownNameError: there is no such clip.
        """
        self._graph = MotionGraph(clips)
        self.skin = self._graph.mesh.skin
        self._clip, self._body = self._graph.source(start).clip, body
        self.walker = Walker(self._graph, start, once=once)
        self.walker.prepare()
        track = body.track(_one_frame(self._clip))
        self.names, self.roles = track.names, track.roles
        self.parents = None if track.parents is None else tuple(int(p) for p in track.parents)
        self._told, self._left = "", 0.0
        self._before = self._after = self._next()
        self._morphs = self._after[1]
        self._frame = 0  # of the graph's, that is `_after`

    def go(self, clip: str) -> None:
        """Pass over to a clip from the next frame on.

        Raises:
            UnknownNameError: there is no such clip.
        """
        self._graph.source(clip)
        self._told = clip

    def turn(self, degrees: float) -> None:
        """Turn on the way by an angle, counter-clockwise from above, on top of what it still has to turn."""
        self._left = max(min(self._left + np.radians(degrees), MOST_TURN), -MOST_TURN)

    @property
    def clips(self) -> tuple[str, ...]:
        """Names of what it can do."""
        return tuple(clip.name for clip in self._graph.clips)

    @property
    def morphs(self) -> FloatArray:
        """Weights of the M morphs of its mesh in the pose that was told last, shape (M,)."""
        return self._morphs

    def pose(self, time: float) -> Pose:
        """Where the bones are at a time [s], between two frames of the clips where it is slower than they are."""
        place = time * self.walker.fps
        whole = int(np.ceil(place - 1e-6))
        while self._frame < whole:
            self._before, self._after = self._after, self._next()
            self._frame += 1
        share = 1.0 - (self._frame - place)
        (before, weights_before), (after, weights) = self._before, self._after
        if share >= 1.0 - 1e-6:
            self._morphs = weights
            return after
        self._morphs = weights_before + share * (weights - weights_before)
        return before.towards(after, share)

    def _next(self) -> tuple[Pose, FloatArray]:
        """The next frame of the clips, and the weights of the mesh's morphs there."""
        told, self._told = self._told, ""
        if told:
            self.walker.go(told)
        turned = max(min(self._left, TURNING / self.walker.fps), -TURNING / self.walker.fps)
        self._left -= turned
        self.walker.turning = turned * self.walker.fps
        rotations, local, morphs = self.walker.next()
        clip = replace(
            self._clip,
            root_positions=local[None, 0],
            rotations_wxyz=quaternions.normalize(rotations)[None],
            local_positions=None if self._clip.local_positions is None else local[None],
            morphs=None,
        )
        track = self._body.track(clip)
        return Pose(track.positions[0], track.rotations_wxyz[0]), morphs


def _one_frame(clip: Clip) -> Clip:
    return replace(
        clip,
        root_positions=clip.root_positions[:1],
        rotations_wxyz=clip.rotations_wxyz[:1],
        local_positions=None if clip.local_positions is None else clip.local_positions[:1],
        morphs=None if clip.morphs is None else clip.morphs[:1],
    )
