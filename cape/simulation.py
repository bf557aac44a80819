"""A cloth that is being simulated: put on, settled, and stepped along with its bones."""

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cape.assemble import Assembly, assemble
from cape.kernels.records import Motion, State
from cape.measure import Meter, Reading, deepest
from cape.scene import Scene, require_held_once
from cape.solvers import Solver, SymplecticEuler
from cape.wear import WEARER_ROLES, wearer_to_world
from motions import quaternions
from motions.errors import UnknownNameError, ValueRangeError

FloatArray = NDArray[np.float64]

SETTLING_FRAME = 1.0 / 60.0  # s
PUT_ON_TIME = 0.8  # s in which what bones hold moves from where it starts to where it is worn
SETTLING_TIME = 3.2  # s at most, from the start
SETTLED_SPEED = 0.02  # m/s, root mean square over the vertices
SETTLING_DAMPING = 0.9  # share of the velocity that is left after each frame of settling
FASTEST = 1e4  # m/s; beyond it a step has exploded, long before numbers overflow
HIGHEST_LIFT = 0.15  # m that a neckline is raised at most to clear the shoulders
LIFT_STEP = 0.002  # m
FARTHEST = 1.0  # m from the cloth's middle to the origin that its positions refer to
RETRIES = 4  # each at half the step or less


class Pose(NamedTuple):
    """Where bones are: origins in the world [m] (B, 3), unit quaternions bone_to_world wxyz (B, 4)."""

    positions: FloatArray
    rotations_wxyz: FloatArray


class Diverged(RuntimeError):
    """A step stayed unstable at the smallest step tried; the text says what to change."""


class Simulation:
    """A running cloth for one's own loop: `start` once with the first pose, then `step` for each new one.

    Bones are given as a mapping from each name in `scene.bones` to (position [m], quaternion bone_to_world wxyz), or as
    a `Pose` in the order of `bones`.
    """

    def __init__(self, scene: Scene, *, solver: Solver | None = None) -> None:
        """Hold the scene and the solver; nothing is computed before `start`."""
        self.scene = scene
        self.solver = solver or SymplecticEuler()
        self.substeps = 0
        self.retried = 0
        self._assembly: Assembly | None = None

    @property
    def bones(self) -> tuple[str, ...]:
        """Names of the bones, or roles, whose poses are needed, in the order of a `Pose`."""
        return self.scene.bones

    @property
    def assembly(self) -> Assembly:
        """The scene's arrays.

        Raises:
            ValueRangeError: the simulation has not been started.
        """
        return self._require_started()

    @property
    def positions(self) -> FloatArray:
        """Positions of the vertices in the world [m], shape (V, 3)."""
        self._require_started()
        return np.stack(self._state[:3], axis=1).astype(float) + self._origin

    @property
    def velocities(self) -> FloatArray:
        """Velocities of the vertices [m/s], shape (V, 3)."""
        self._require_started()
        return np.stack(self._state[3:], axis=1).astype(float)

    def start(
        self,
        bones: "Mapping[str, tuple[ArrayLike, ArrayLike]] | Pose",
        *,
        settle: float | None = None,
        velocity: ArrayLike = (0.0, 0.0, 0.0),
        spin: ArrayLike = (0.0, 0.0, 0.0),
    ) -> None:
        """Put the cloth on bones that stand still, compile what the scene needs, and let the cloth settle.

        Args:
            bones: the first pose.
            settle: time to let the cloth come to rest [s], damped beyond its nature; None for as long as a cape takes
                to be put on and settle, and for no time where the cloth starts in the world.
            velocity: with which the bones that hold the cloth move on [m/s]; the cloth settles in their own wind.
            spin: with which they turn [rad/s]; the cloth sets out as if rigid.

        Raises:
            UnknownNameError: a bone's pose is missing.
            ValueRangeError: the pose is not finite, the cape can't be put on, or a vertex is held by two bones.
        """
        self._assembly, self._origin = None, np.zeros(3)
        self._pose = self._read(bones)
        positions = self._placed_cloth()
        self._origin = np.round(positions.mean(axis=0))
        self._pose = _moved(self._pose, -self._origin)
        positions = positions - self._origin
        held = [self._held(a, positions) for a in self.scene.attachments]
        require_held_once(held)
        self._assembly = assemble(self.scene, held, self.solver.dtype)
        self._room = self.solver.init(self._assembly)
        self._state = _at_rest(positions, self.solver.dtype)
        worn, spread = self._hold_points(held, positions)
        put_on = not np.array_equal(worn, spread)
        if settle is None:
            settle = SETTLING_TIME if put_on else 0.0
        self._settle(settle, spread, worn, np.asarray(velocity, dtype=float))
        self._set_out(np.asarray(velocity, dtype=float), np.asarray(spin, dtype=float))

    def compile(self, bones: "Mapping[str, tuple[ArrayLike, ArrayLike]] | Pose") -> None:
        """Compile, or load from the cache, all that the scene needs; `start` would, this call only moves the time."""
        self.start(bones, settle=SETTLING_FRAME)
        self.read(self.meter())

    def step(self, bones: "Mapping[str, tuple[ArrayLike, ArrayLike]] | Pose", dt: float) -> None:
        """Advance the cloth by `dt` [s], in which the bones move from where they were to the given pose.

        Starts the simulation with that pose if it has not been started. A step that explodes is taken back and done
        again with half the step, or as small a one as the solver would have chosen.

        Raises:
            UnknownNameError: a bone's pose is missing.
            ValueRangeError: the pose is not finite, or `dt` is not positive.
            Diverged: the step explodes at any size; the state is as before.
        """
        if not 0.0 < dt < float("inf"):
            raise ValueRangeError(f"the time step must be positive and finite, not {dt}")
        if self._assembly is None:
            self.start(bones)
        self._recenter()
        pose = self._read(bones)
        motion = Motion(self._pose.positions, self._pose.rotations_wxyz, pose.positions, pose.rotations_wxyz)
        before = [component.copy() for component in self._state]
        self.substeps = self.solver.choose_substeps(self._room, dt)
        substeps = self.substeps
        for attempt in range(RETRIES + 1):
            if attempt > 0:
                # A count between what explodes and what is stable may grow slowly enough to pass for sound.
                own_choice = replace(self.solver, substeps=None).choose_substeps(self._room, dt)
                substeps = max(2 * substeps, own_choice)
            self.solver.step(self.assembly, self._room, self._state, motion, duration=dt, substeps=substeps)
            if self._sound():
                self.retried += attempt > 0
                self._pose = pose
                return
            for component, kept in zip(self._state, before, strict=True):
                component[:] = kept
        raise Diverged(
            f"the cloth explodes even at {substeps} substeps per frame: "
            "use a softer or heavier fabric, a wider spacing, or the solver xpbd"
        )

    def meter(self) -> Meter:
        """Give a meter for this run."""
        return Meter(self.assembly)

    def read(self, meter: Meter) -> Reading:
        """Measure the cloth as it is now."""
        return meter.read(self._state, self._pose.positions, self._pose.rotations_wxyz)

    def _require_started(self) -> Assembly:
        if self._assembly is None:
            raise ValueRangeError("the simulation has not been started: call start with the first pose of the bones")
        return self._assembly

    def _read(self, bones: "Mapping[str, tuple[ArrayLike, ArrayLike]] | Pose") -> Pose:
        """Check a pose and add the world as the last bone."""
        if isinstance(bones, Pose):
            positions, rotations = np.asarray(bones.positions), np.asarray(bones.rotations_wxyz)
        else:
            missing = [b for b in self.bones if b not in bones]
            if missing:
                raise UnknownNameError("bone", missing[0], bones, "The scene uses " + ", ".join(self.bones))
            positions = np.array([bones[b][0] for b in self.bones], dtype=float).reshape(-1, 3)
            rotations = np.array([bones[b][1] for b in self.bones], dtype=float).reshape(-1, 4)
        if positions.shape != (len(self.bones), 3) or rotations.shape != (len(self.bones), 4):
            raise ValueRangeError(f"a pose of {len(self.bones)} bones is needed: {', '.join(self.bones)}")
        if not (np.isfinite(positions).all() and np.isfinite(rotations).all()):
            raise ValueRangeError("the pose of the bones is not finite")
        if not np.linalg.norm(rotations, axis=1).all():
            raise ValueRangeError("the rotation of a bone is a quaternion of zeros")
        return Pose(
            np.concatenate([positions, np.zeros((1, 3))]) - self._origin,
            np.concatenate([quaternions.normalize(rotations), [[1.0, 0.0, 0.0, 0.0]]]),
        )

    def _wearer(self) -> tuple[FloatArray, FloatArray]:
        left, right, pelvis = (self._pose.positions[self.bones.index(role)] for role in WEARER_ROLES)
        return wearer_to_world(left, right, pelvis)

    def _placed_cloth(self) -> FloatArray:
        """Positions of the vertices in the world where the cloth starts [m], shape (V, 3)."""
        cloth = self.scene.cloth
        if cloth.frame == "world":
            return cloth.positions
        rotation, origin = self._wearer()
        return origin + cloth.positions @ rotation.T

    def _held(self, attachment, positions: FloatArray) -> NDArray[np.int64]:
        """Vertices that an attachment holds, once it is known where the cloth is put on."""
        if attachment.within is None:
            return attachment.vertices
        bone = self._pose.positions[self.bones.index(attachment.bone)]
        worn = self._worn(positions)[attachment.vertices]
        near = attachment.vertices[np.linalg.norm(worn - bone, axis=1) <= attachment.within]
        if near.size == 0:
            closest = np.linalg.norm(worn - bone, axis=1).min()
            raise ValueRangeError(
                f"no vertex is within {attachment.within} m of {attachment.bone!r}; the closest is {closest:.3f} m off"
            )
        return near

    def _worn(self, positions: FloatArray) -> FloatArray:
        """Where the vertices would be held [m]: the neckline for the top row, otherwise where they start."""
        cloth = self.scene.cloth
        if cloth.neckline is None:
            return positions
        rotation, origin = self._wearer()
        worn = positions.copy()
        worn[: cloth.columns] = origin + cloth.neckline @ rotation.T
        return worn

    def _hold_points(self, held: list[NDArray[np.int64]], positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Points at which bones hold the vertices, in the bones' frames [m]: where they are worn, where they start."""
        attached = self.assembly.attached
        if attached is None:
            return np.zeros((0, 3)), np.zeros((0, 3))
        origin = self._pose.positions[attached.bones]
        turn = self._pose.rotations_wxyz[attached.bones]

        def in_bones(points: FloatArray) -> FloatArray:
            return quaternions.rotate(quaternions.conjugate(turn), points[attached.vertices] - origin)

        worn = self._worn(positions)
        if self.scene.cloth.neckline is not None:
            worn[: self.scene.cloth.columns] += self._lift(worn)
        worn, spread = in_bones(worn), in_bones(positions)
        first = 0
        for attachment, vertices in zip(self.scene.attachments, held, strict=True):
            if attachment.points is not None:
                worn[first : first + len(vertices)] = attachment.points
            first += len(vertices)
        if self.scene.cloth.frame == "world":
            spread = worn
        return worn, spread

    def _lift(self, worn: FloatArray) -> FloatArray:
        """The least way up the wearer's trunk that takes the neckline clear of all colliders [m], shape (3,)."""
        columns = self.scene.cloth.columns
        counted = np.ones(columns, dtype=bool)
        up = self._wearer()[0][:, 2]
        for height in np.arange(0.0, HIGHEST_LIFT, LIFT_STEP):
            points = worn[:columns] + height * up
            inside, _ = deepest(self.assembly, tuple(points.T), counted, self._pose, margin=self.scene.thickness)
            if inside == 0.0:
                return height * up
        return np.zeros(3)

    def _settle(self, duration: float, spread: FloatArray, worn: FloatArray, velocity: FloatArray) -> None:
        """Bring the cloth to rest on bones that stand still, moving what they hold from `spread` to `worn`."""
        attached, air, pose = self.assembly.attached, self.assembly.air, self._pose
        if air is not None:
            air.wind[:] -= velocity
        motion = Motion(*pose, *pose)
        substeps = self.solver.choose_substeps(self._room, SETTLING_FRAME)
        for frame in range(1, round(duration / SETTLING_FRAME) + 1):
            time = frame * SETTLING_FRAME
            if attached is not None:
                share = min(time / PUT_ON_TIME, 1.0)
                share = share * share * (3.0 - 2.0 * share)
                attached.points[:] = spread + share * (worn - spread)
            self.solver.step(self.assembly, self._room, self._state, motion, duration=SETTLING_FRAME, substeps=substeps)
            for component in self._state[3:]:
                component *= SETTLING_DAMPING
            speed = np.sqrt(sum(float(np.mean(np.square(c, dtype=float))) for c in self._state[3:]))
            if time > 1.5 * PUT_ON_TIME and speed < SETTLED_SPEED:
                break
        if attached is not None:
            attached.points[:] = worn
        if air is not None:
            air.wind[:] += velocity

    def _set_out(self, velocity: FloatArray, spin: FloatArray) -> None:
        """Give the cloth the velocity of what holds it, as if it were rigid."""
        attached = self.assembly.attached
        if attached is None:
            return
        center = self._origin + self._pose.positions[attached.bones].mean(axis=0)
        for component, added in zip(
            self._state[3:], (velocity + np.cross(spin, self.positions - center)).T, strict=True
        ):
            component += added

    def _recenter(self) -> None:
        """Keep the cloth near the origin that its positions refer to: far from it single precision is coarse."""
        center = np.array([float(c.mean(dtype=float)) for c in self._state[:3]])
        if np.abs(center).max() < FARTHEST:
            return
        shift = np.round(center).astype(float)
        for component, moved in zip(self._state[:3], shift, strict=True):
            component -= component.dtype.type(moved)
        self._origin = self._origin + shift
        self._pose = _moved(self._pose, -shift)

    def _sound(self) -> bool:
        """Tell whether all numbers are finite and no vertex is faster than anything real."""
        return all(np.isfinite(c).all() for c in self._state) and all(
            float(np.abs(c).max()) < FASTEST for c in self._state[3:]
        )


def _moved(pose: Pose, shift: FloatArray) -> Pose:
    return Pose(pose.positions + shift, pose.rotations_wxyz)


def _at_rest(positions: FloatArray, dtype: type[np.floating]) -> State:
    """State of vertices at positions [m], shape (V, 3), without velocity; six arrays that share no memory."""
    return State(*(np.array(p, dtype=dtype) for p in positions.T), *(np.zeros(len(positions), dtype) for _ in range(3)))
