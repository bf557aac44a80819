"""A cloth that is being simulated: put on, settled, and stepped along with its bones."""

import math
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cape import layers, team, wear
from cape.assemble import Assembly, assemble
from cape.cuts import Cuts, rigid_motion
from cape.kernels.measure import is_strained, whereabouts
from cape.kernels.records import Motion, State
from cape.measure import Meter, Reading
from cape.poses import Bones, Pose, read_pose
from cape.scene import Scene, require_held_once
from cape.solvers import Solver, SymplecticEuler
from motions.errors import ValueRangeError

FloatArray = NDArray[np.float64]

SETTLING_FRAME = 1.0 / 60.0  # s
PUT_ON_TIME = 0.8  # s in which what bones hold moves from where it starts to where it is worn
SETTLING_TIME = 3.2  # s at most, from the start
SETTLED_SPEED = 0.02  # m/s, root mean square over the vertices
SETTLING_DAMPING = 0.9  # share of the velocity that is left after each frame of settling
FASTEST = 1e4  # m/s; beyond it a step has exploded, long before numbers overflow
FARTHEST_LEAP = 1e6  # m from the cloth's own origin; the same
FARTHEST = 1.0  # m from the cloth's middle to the origin that its positions refer to
RETRIES = 4  # each at half the step or less
CONVERGENCE_RETRIES = 2  # after which a step that did not converge is kept, and counted
WHIRL_RETRIES = 3  # after which one that whirls is kept
WILD = 60.0  # m/s: faster than cloth gets on a body, and a sign that strained springs are too stiff for the step
STRAINED = 0.2  # from which on springs resist across their direction, too, as much as matters for the step
MOST_HASTE = 8.0  # times as many steps as usual, that are taken for thin colliders that come by fast
FORECAST_SUBSTEPS = 50
DEFAULT_CUTS = Cuts()


class Forecast(NamedTuple):
    """What a frame takes: steps of the solver, and wall time [s]."""

    substeps: int
    seconds: float


class Moment(NamedTuple):
    """The state at some time, and what was known then: how the cloth touches itself, where it is, if it is strained."""

    state: tuple[NDArray[np.floating], ...]
    layers: layers.Kept | None
    center: FloatArray
    strained: bool


class Diverged(RuntimeError):
    """A step stayed unstable at the smallest step tried; the text says what to change."""


class Simulation:
    """A running cloth for one's own loop: `start` once with the first pose, then `step` for each new one.

    Bones are given as a mapping from each name in `scene.bones` to (position [m], quaternion bone_to_world wxyz), or as
    a `Pose` in the order of `bones`.

    Attributes:
        scene: cloth, attachments, colliders, forces.
        solver: how it is advanced.
        threads: how many share the cloth at most.
        substeps: steps of the last frame, as chosen first.
        retried: frames since the start that exploded and were done again in shorter steps.
        refined: frames that were taken in shorter steps, as the longer ones did not converge, made parts whirl,
            strained springs too far, or let thin colliders come by too far.
        unconverged: frames that did not converge in shorter steps either.
        cuts: what counts as a jump of the bones, and what becomes of the cloth; None to take all as motion.
        jumps: frames in which the bones have jumped.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        solver: Solver | None = None,
        threads: int | None = None,
        cuts: Cuts | None = DEFAULT_CUTS,
    ) -> None:
        """Hold the scene and the solver; nothing is computed before `start`.

        Args:
            scene: cloth, attachments, colliders, forces.
            solver: None for symplectic Euler with the step that the scene needs.
            threads: how many share the cloth, None for as many as pay off; the results are the same.
            cuts: what counts as a jump of the bones, and what becomes of the cloth; None to take all as motion.

        Raises:
            ValueRangeError: the number of threads is not positive.
        """
        if threads is not None and threads < 1:
            raise ValueRangeError(f"threads must be 1 or more, not {threads}")
        self.scene = scene
        self.solver = solver or SymplecticEuler()
        self.threads = threads or team.threads_for(scene.cloth.vertices)
        self.substeps = 0
        self.retried = 0
        self.refined = 0
        self.unconverged = 0
        self.cuts = cuts
        self.jumps = 0
        self._assembly: Assembly | None = None
        self._center, self._strained = np.zeros(3), False

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
        return self.assembly.outwards(np.stack(self._state[:3], axis=1).astype(float)) + self._origin

    @property
    def velocities(self) -> FloatArray:
        """Velocities of the vertices [m/s], shape (V, 3)."""
        return self.assembly.outwards(np.stack(self._state[3:], axis=1).astype(float))

    def start(
        self,
        bones: Bones,
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
            ValueRangeError: a pose, velocity or spin isn't finite, the cape can't be put on, or a vertex is held twice.
            Diverged: the cloth explodes while it settles.
        """
        moving, turning = _vector(velocity, "velocity"), _vector(spin, "spin")
        self.substeps = self.retried = self.refined = self.unconverged = self.jumps = 0
        self._put_on(read_pose(bones, self.bones), settle, moving, turning)

    def _put_on(self, pose: Pose, settle: float | None, moving: FloatArray, turning: FloatArray) -> None:
        self._assembly, self._origin, self._first_pose = None, np.zeros(3), pose
        positions = wear.placed(self.scene, pose)
        self._origin = np.round(positions.mean(axis=0))
        self._pose = pose.moved(-self._origin)
        positions = positions - self._origin
        held = [wear.held_by(self.scene, a, self._pose, positions) for a in self.scene.attachments]
        require_held_once(held)
        self._assembly = assemble(self.scene, held, threads=self.threads)
        self._room = self.solver.init(self._assembly)
        self._state = State.at_rest(self._assembly.inwards(positions), self.solver.dtype(self._assembly))
        try:
            worn, spread = wear.hold_points(self._assembly, self._pose, held, positions)
            put_on = not np.array_equal(worn, spread)
            if settle is None:
                settle = SETTLING_TIME if put_on else 0.0
            self._settle(settle, spread, worn, moving)
            self._set_out(moving, turning)
            if not self._sound():
                raise self._diverged(self._own_choice(SETTLING_FRAME))
        except BaseException:
            self._assembly = None
            raise

    def compile(self, bones: Bones) -> None:
        """Compile, or load from the cache, all that the scene needs; `start` would, this call only moves the time."""
        self.start(bones, settle=SETTLING_FRAME)
        self.read(self.meter())

    def step(self, bones: Bones, dt: float) -> None:
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
        pose = read_pose(bones, self.bones).moved(-self._origin)
        if self.cuts is not None and self.cuts.between(self._pose, pose, dt, self._holding):
            self.jumps += 1
            pose = self._reset(pose) if self.cuts.then == "reset" else self._carry(pose)
        motion = Motion(*self._pose, *pose)
        self.substeps = self.solver.choose_substeps(self._room, dt, strained=self._strained)
        with self._taken_back() as before:
            self._try(motion, dt, before)
        self._pose = pose

    @property
    def _holding(self) -> NDArray[np.int64]:
        """The bones that hold the cloth."""
        attached = self.assembly.attached
        return np.empty(0, dtype=np.int64) if attached is None else np.unique(attached.bones)

    def _reset(self, pose: Pose) -> Pose:
        """Put the cloth on anew where the bones have jumped to, and give their pose from its new origin."""
        pose = pose.moved(self._origin)
        if self.scene.cloth.frame == "wearer":
            self._put_on(pose, None, np.zeros(3), np.zeros(3))
            return self._pose
        # A cloth that started in the world did so where the first pose of its bones was.
        self._put_on(self._first_pose, None, np.zeros(3), np.zeros(3))
        return self._carry(pose.moved(-self._origin))

    def _carry(self, pose: Pose) -> Pose:
        """Move the cloth as a whole to where the bones have jumped, and give their pose from its new origin."""
        attached = self.assembly.attached
        if attached is not None:
            before = wear.held_points(attached, self._pose)
            rotation, shift = rigid_motion(before, wear.held_points(attached, pose))
            places = np.stack(self._state[:3], axis=1) @ rotation.T + shift
            velocities = np.stack(self._state[3:], axis=1) @ rotation.T
            moved = np.round(places.mean(axis=0))
            for component, values in zip(self._state, (*(places - moved).T, *velocities.T), strict=True):
                component[:] = values
            self._origin = self._origin + moved
            pose = pose.moved(-moved)
            if self.assembly.layers is not None:
                layers.turn(self.assembly.layers, rotation)
            # How the jump has changed the bones' places to each other is caught up with slowly.
            carried = before @ rotation.T + shift - moved
            attached.lift[:] = wear.in_bones(attached, pose, carried) - attached.points
        self._pose = pose
        self._sound()
        return pose

    def _try(self, motion: Motion, dt: float, before: Moment) -> None:
        """Take a step at half the size while it explodes, a few times at most if it whirls or does not converge."""
        substeps, exploded, refined = self.substeps, False, False
        for attempt in range(RETRIES + 1):
            unconverged, sound = self._complete(motion, dt, substeps, before)
            if attempt == 0 and sound and (needed := self._needed_substeps(substeps, dt)) > substeps:
                self._restore(before)
                substeps, refined = needed, True
                unconverged, sound = self._complete(motion, dt, substeps, before)
            patience = WHIRL_RETRIES if self._whirls() else CONVERGENCE_RETRIES if unconverged else 0
            if sound and attempt >= patience:
                self.retried += exploded
                self.refined += refined and unconverged == 0
                self.unconverged += unconverged > 0
                self._note_lift(dt)
                return
            exploded, refined = exploded or not sound, refined or sound
            if attempt < RETRIES:
                self._restore(before)
                # A count between what explodes and what is stable may grow slowly enough to pass for sound.
                substeps = max(2 * substeps, self._own_choice(dt, strained=True))
        raise self._diverged(substeps)

    def _whirls(self) -> bool:
        """Tell whether any vertex is faster than most motions make it; few are, and the step is then worth a check."""
        *_, slow = whereabouts(*self._state, FARTHEST_LEAP, WILD)
        return not slow

    def _needed_substeps(self, substeps: int, dt: float) -> int:
        """Substeps that a frame of `dt` [s] would have needed, seen after taking it in fewer."""
        if self.solver.substeps is not None:
            return substeps
        faces = self.assembly.ranks[0].contacts.faces
        haste = max((float(group.haste[0]) for group in faces or ()), default=0.0)
        needed = math.ceil(substeps * min(haste, MOST_HASTE))
        if self._strained:
            needed = max(needed, self.solver.choose_substeps(self._room, dt, strained=True))
        return needed

    def _own_choice(self, dt: float, *, strained: bool = False) -> int:
        """Substeps in `dt` [s] that the solver would choose, whatever was asked for."""
        return replace(self.solver, substeps=None).choose_substeps(self._room, dt, strained=strained)

    def _diverged(self, substeps: int) -> Diverged:
        return Diverged(
            f"the cloth explodes even at {substeps} substeps per frame: "
            "use a softer or heavier fabric, a wider spacing, or another solver (xpbd, tr_bdf2)"
        )

    def forecast(self, dt: float) -> Forecast:
        """Tell what a frame of `dt` [s] takes, by stepping a part of one and taking it back.

        Raises:
            ValueRangeError: the simulation has not been started.
        """
        self._require_started()
        substeps = self.solver.choose_substeps(self._room, dt)
        tried = min(substeps, FORECAST_SUBSTEPS)
        seconds = []
        with self._taken_back() as before:
            for _ in range(2):
                begun = time.perf_counter()
                self._complete(Motion(*self._pose, *self._pose), dt * tried / substeps, tried, before)
                seconds.append((time.perf_counter() - begun) * substeps / tried)
                self._restore(before)
        return Forecast(substeps, min(seconds))

    def meter(self, scene: Scene | None = None) -> Meter:
        """Give a meter for this run, of the colliders of another scene of the same cloth where one is given."""
        return Meter(self.assembly, scene)

    def read(self, meter: Meter, bones: Bones | None = None) -> Reading:
        """Measure the cloth as it is now; a meter of another scene needs the poses of that scene's bones."""
        pose = self._pose if bones is None else read_pose(bones, meter.scene.bones).moved(-self._origin)
        return meter.read(self._state, pose, origin=self._origin)

    def _require_started(self) -> Assembly:
        if self._assembly is None:
            raise ValueRangeError("the simulation has not been started: call start with the first pose of the bones")
        return self._assembly

    def _settle(self, duration: float, spread: FloatArray, worn: FloatArray, velocity: FloatArray) -> None:
        """Bring the cloth to rest on bones that stand still, moving what they hold from `spread` to `worn`."""
        attached, wind, pose = self.assembly.attached, self.assembly.wind, self._pose
        wind -= velocity
        motion = Motion(*pose, *pose)
        substeps = max(self.solver.choose_substeps(self._room, SETTLING_FRAME), self._own_choice(SETTLING_FRAME))
        for frame in range(1, round(duration / SETTLING_FRAME) + 1):
            now = frame * SETTLING_FRAME
            if attached is not None:
                share = min(now / PUT_ON_TIME, 1.0)
                share = share * share * (3.0 - 2.0 * share)
                attached.points[:] = spread + share * (worn - spread)
            self._complete(motion, SETTLING_FRAME, substeps, self._moment())
            self._note_lift(SETTLING_FRAME)
            for component in self._state[3:]:
                component *= SETTLING_DAMPING
            speed = np.sqrt(sum(float(np.mean(np.square(c, dtype=float))) for c in self._state[3:]))
            if now > 1.5 * PUT_ON_TIME and speed < SETTLED_SPEED:
                break
        if attached is not None:
            attached.points[:] = worn
        wind += velocity

    def _set_out(self, velocity: FloatArray, spin: FloatArray) -> None:
        """Give the cloth the velocity of what holds it, as if it were rigid."""
        attached = self.assembly.attached
        if attached is None:
            return
        center = self._origin + self._pose.positions[attached.bones].mean(axis=0)
        carried = velocity + np.cross(spin, self.positions - center)
        for component, added in zip(self._state[3:], self.assembly.inwards(carried.astype(float)).T, strict=True):
            component += added

    def _advance(self, motion: Motion, duration: float, substeps: int) -> int:
        return self.solver.step(
            self.assembly, self._room, self._state, motion, duration=duration, substeps=substeps, threads=self.threads
        )

    def _complete(self, motion: Motion, duration: float, substeps: int, before: Moment) -> tuple[int, bool]:
        """Advance a frame, again from the moment before it where pairs of layers had no room in their lists.

        Returns how many solves did not converge, and whether the result is sound.
        """
        while True:
            unconverged = self._advance(motion, duration, substeps)
            known, sound = self.assembly.layers, self._sound()
            if known is None or layers.surplus(known) == 0:
                return unconverged, sound
            if not sound or not layers.may_grow(known):
                return unconverged, False
            self._assembly = self.assembly.with_layers(layers.enlarged(known))
            self._restore(before)

    def _note_lift(self, duration: float) -> None:
        """Note how far what bones hold has drifted out of colliders in a frame of `duration` [s]."""
        attached = self.assembly.attached
        if attached is not None:
            attached.lift[:] += duration * attached.drift

    def _recenter(self) -> None:
        """Keep the cloth near the origin that its positions refer to: far from it single precision is coarse."""
        if np.abs(self._center).max() < FARTHEST:
            return
        shift = np.round(self._center).astype(float)
        for component, moved in zip(self._state[:3], shift, strict=True):
            component -= component.dtype.type(moved)
        self._origin = self._origin + shift
        self._pose = self._pose.moved(-shift)

    def _sound(self) -> bool:
        """Tell whether no vertex is farther or faster than anything real.

        Notes where the cloth is, and whether it is strained.
        """
        *center, sound = whereabouts(*self._state, FARTHEST_LEAP, FASTEST)
        springs = self.assembly.springs
        self._center = np.array(center)
        self._strained = bool(is_strained(*self._state[:3], springs.first, springs.second, springs.rest, STRAINED))
        return sound

    @contextmanager
    def _taken_back(self) -> Iterator[Moment]:
        """Keep a copy of the state, and put it back should anything be raised within."""
        before = self._moment()
        try:
            yield before
        except BaseException:
            self._restore(before)
            raise

    def _moment(self) -> Moment:
        known = self.assembly.layers
        kept = None if known is None else layers.keep(known)
        return Moment(tuple(c.copy() for c in self._state), kept, self._center, self._strained)

    def _restore(self, before: Moment) -> None:
        for component, kept in zip(self._state, before.state, strict=True):
            component[:] = kept
        self._center, self._strained = before.center, before.strained
        if self.assembly.layers is not None and before.layers is not None:
            layers.put_back(self.assembly.layers, before.layers)


def _vector(values: ArrayLike, name: str) -> FloatArray:
    vector = np.asarray(values, dtype=float)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise ValueRangeError(f"the {name} at the start must be three finite numbers, not {values}")
    return vector
