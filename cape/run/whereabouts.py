"""Where a simulation was, what it takes, and how it fails."""

from typing import NamedTuple

from cape.run.hanging import Frame, Place
from cape.scene.poses import Pose
from cape.scene.scene import Scene
from cape.solvers import Solver
from motions.errors import UserError


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
