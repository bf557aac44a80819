"""What is timed: a solver on an assembled scene, without the Python around it."""

import numpy as np
from numpy.typing import NDArray

from cape.assembly.assemble import Assembly
from cape.bench.timing import Probe
from cape.cloth.cloth import GridCloth
from cape.kernels.bones import Motion
from cape.kernels.state import State
from cape.measure.meter import Meter
from cape.scene.poses import Pose
from cape.scene.scene import Scene
from cape.scene.standard_scenes import FPS
from cape.solvers import Solver
from motions import quaternions
from skeleton.track import BoneTrack

FloatArray = NDArray[np.float64]

BEGIN, PERIOD = 1.0, 1.0  # s, of the motion that is repeated
MOST_UNITS = 2e6  # vertices times substeps in a call; larger cloths are stepped by parts of a frame
FEWEST_SUBSTEPS = 4


class Subject(Probe):
    """A solver that steps an assembled scene, frame by frame, over one second of its motion and again.

    Attributes:
        assembly: the scene's arrays.
        solver: the solver.
        state: of the cloth.
        running: the solver at work on it.
        frame_substeps: in a frame of a 60th of a second.
        substeps: in a call.
        threads: that share the cloth.
        code: that its steps are made of.
    """

    def __init__(
        self,
        assembly: Assembly,
        track: BoneTrack,
        solver: Solver,
        *,
        threads: int = 1,
        warm: int = 5,
        read: bool = False,
    ) -> None:
        """Put the cloth where it starts, on bones in their first pose.

        Args:
            assembly: a scene's arrays, which subjects that take turns may share.
            track: poses of its bones, at least two seconds.
            solver: the solver.
            threads: that share the cloth.
            warm: calls before what is timed.
            read: read the cloth's statistics after each call.
        """
        self.solver, self.threads = solver, threads
        self.assembly, scene = assembly, assembly.scene
        self.state = State.at_rest(assembly.cloth.positions, solver.dtype(assembly))
        self.running = solver.init(assembly, self.state)
        frame = 1.0 / FPS
        chosen = solver.choose_substeps(self.running, frame)
        most = max(FEWEST_SUBSTEPS, int(MOST_UNITS / self.assembly.cloth.vertices))
        self.frame_substeps, self.substeps = chosen, min(chosen, most)
        self.units = float(self.assembly.cloth.vertices * self.substeps)
        self._duration = frame * self.substeps / chosen
        self._poses = _poses(scene, track, self._duration)
        self._hold()
        self._frame, self._begin, self._warm = 0, 0, warm
        self._start = self._copy()
        self._meter = Meter(self.assembly) if read else None
        self.code = frozenset(solver.requests(self.running, threads))
        self.requests = [*self.code, *([] if self._meter is None else self._meter.requests(self.state))]

    @property
    def substep(self) -> float:
        """Length of a substep [s]."""
        return self._duration / self.substeps

    @property
    def layout(self) -> str:
        """Grid or mesh."""
        return "grid" if isinstance(self.assembly.cloth, GridCloth) else "mesh"

    @property
    def precision(self) -> str:
        """Single or double."""
        return "single" if self.state.x.dtype == np.float32 else "double"

    def call(self) -> None:
        """Step by a frame, or by a part of one."""
        positions, rotations = self._poses
        k = self._frame % (len(positions) - 1)
        motion = Motion(positions[k], rotations[k], positions[k + 1], rotations[k + 1])
        self.solver.step(self.running, motion, duration=self._duration, substeps=self.substeps, threads=self.threads)
        self._frame += 1
        if self._meter is not None:
            self._meter.read(self.state, Pose(positions[k + 1], rotations[k + 1]))

    def prepare(self) -> None:
        """Step until the cloth is in motion."""
        for _ in range(self._warm):
            self.call()
        self._start, self._begin = self._copy(), self._frame

    def rewind(self) -> None:
        """Put the cloth back."""
        self._frame = self._begin
        for component, kept in zip(self.state, self._start, strict=True):
            component[:] = kept

    def _copy(self) -> State:
        return State(*(component.copy() for component in self.state))

    def _hold(self) -> None:
        """Let bones hold the attached vertices where they are, relative to where the bones are at the start."""
        attached = self.assembly.attached
        if attached is not None:
            positions, rotations = (poses[0, attached.bones] for poses in self._poses)
            place = self.assembly.cloth.positions[attached.vertices] - positions
            attached.points[:] = quaternions.rotate(quaternions.conjugate(rotations), place)


def _poses(scene: Scene, track: BoneTrack, duration: float) -> tuple[FloatArray, FloatArray]:
    """Poses of the scene's bones and of the world, about every `duration` [s] until the motion repeats.

    Positions [m] (T, B, 3) and rotations bone_to_world wxyz (T, B, 4).
    """
    chosen = [track.index(bone) for bone in scene.bones]
    count = max(1, round(PERIOD / duration))
    positions, rotations = track.sample(BEGIN + PERIOD * np.arange(count + 1) / count)
    world = np.broadcast_to([1.0, 0.0, 0.0, 0.0], (count + 1, 1, 4))
    return (
        np.concatenate([positions[:, chosen], np.zeros((count + 1, 1, 3))], axis=1),
        np.concatenate([rotations[:, chosen], world], axis=1),
    )
