"""Where a cloth and its simulation were, what a frame takes, and how it fails."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assembly import self_contact
from cape.scene.poses import Pose
from cape.scene.scene import Scene
from cape.solvers import Solver
from motions.errors import UserError

FloatArray = NDArray[np.float64]


class Moment(NamedTuple):
    """The state at some time, and what was known then: how the cloth touches itself, which vertices two colliders
    pinch, which slip off one, by how far threads have drawn them, for how many frames they have not been limited, or
    have been too long nevertheless, where it is, if it is strained."""

    state: tuple[NDArray[np.floating], ...]
    layers: self_contact.Kept | None
    pinched: NDArray[np.bool_]
    slips: NDArray[np.int64]
    drawn: FloatArray
    idle: int
    lasting: int
    center: FloatArray
    strained: bool


Hold = tuple[NDArray[np.floating], NDArray[np.floating], NDArray[np.floating]]
"""Points, lift and drift of `Attached`."""


class Place(NamedTuple):
    """Where a cloth is, whatever solver and threads move it.

    `state` is of the vertices as the scene numbers them, about `origin`, shape (V, 6); `hold` are the points, lift and
    drift of all that bones carry; `time` [s] is since the bones left their first pose.
    """

    origin: FloatArray
    pose: Pose
    state: FloatArray
    hold: tuple[Hold, ...]
    time: float


class Frame(NamedTuple):
    """All that a cloth goes on from after a frame: a moment, where its origin and the bones are, what they carry, and
    how long it is since they left their first pose [s]."""

    moment: Moment
    origin: FloatArray
    pose: Pose
    hold: tuple[Hold, ...]
    time: float


class Forecast(NamedTuple):
    """What a frame takes: steps of the solver, and wall time [s]."""

    substeps: int
    seconds: float


class Snapshot(NamedTuple):
    """Where the cloth of a scene was at some time, and the bones when it was put on."""

    scene: Scene
    first_pose: Pose
    place: Place


class Mark(NamedTuple):
    """Where a simulation was: what its cloth goes on from, its solver, and what it says of itself."""

    frame: Frame
    solver: Solver
    counts: tuple[int, ...]


class Diverged(UserError, RuntimeError):
    """A step stayed unstable at the smallest step tried; the text says what to change."""
