"""A cloth that hangs on its bones: its arrays and where they are, how it settles, and how a frame can be taken back."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cape.assembly import putting_on, self_contact
from cape.assembly.assemble import Assembly, assemble
from cape.kernels.bones import Motion
from cape.kernels.calling import Bound
from cape.kernels.cloth.measure import whereabouts
from cape.kernels.contact.slip import NOT
from cape.kernels.solve.journal import Journal
from cape.kernels.solve.soft import Pull
from cape.kernels.state import State
from cape.kernels.store import Request
from cape.run.contact.slips import Slips
from cape.run.strain_limit import StrainLimit, strain_check
from cape.run.weather import Weather
from cape.run.whereabouts import Frame, Hold, Moment, Place
from cape.scene.jumps import rigid_motion
from cape.scene.poses import Pose
from cape.scene.scene import Scene, require_held_once
from cape.solvers import Solver
from cape.solvers.base import MOST_SUBSTEPS
from motions.errors import ValueRangeError

if TYPE_CHECKING:
    from cape.assembly.mesh.split_springs import Changed

FloatArray = NDArray[np.float64]

FASTEST = 1e4  # m/s; beyond it a step has exploded, long before numbers overflow
FARTHEST_LEAP = 1e6  # m from the cloth's own origin; the same
FARTHEST = 1.0  # m from the cloth's middle to the origin that its positions refer to
WILD = 60.0  # m/s: faster than cloth gets on a body, and a sign that strained springs are too stiff for the step
PARTED = 0.1  # of the way from the middle of all held points to the farthest: beyond it, bones pose otherwise
STRAINED = 0.2  # from which on springs resist across their direction, too, as much as matters for the step


class Hanging:
    """A cloth put on, at rest at first.

    Attributes:
        assembly: the scene's arrays.
        state: of the vertices as the assembly numbers them, about `origin`.
        origin: that positions and poses refer to, in the world [m], shape (3,).
        pose: where the bones are, about `origin`.
        holding: the bones that hold the cloth.
        held: the vertices that each attachment holds, as the scene numbers them.
        running: the solver at work.
        strained: whether springs are so long that steps must be shorter.
        keeps_journal: whether it is noted what substeps do.
        journal: of the last frame that was noted.
        limit: of the strain of its threads, from frame to frame.
        slips: what of it slips off limbs that have gone through it.
        time: since the bones left their first pose [s].
        weather: what blows.
        first: pose of the bones, about `origin`, in which the cloth is worn at first.
        ways: what bones carry, and where they hold it in their frames [m] when it is worn, and as it starts.
    """

    def __init__(self, scene: Scene, solver: Solver, pose: Pose, *, threads: int, hands: Pull | None = None) -> None:
        """Lay the cloth out on bones at a pose in the world; `hands` may take hold of it.

        Raises:
            ValueRangeError: the cape can't be put on, or a vertex is held twice.
        """
        self._solver, self._threads = solver, threads
        first, pose = pose, putting_on.dressing_pose(scene, pose)
        positions = putting_on.placed(scene, pose)
        self.origin = np.round(positions.mean(axis=0))
        self.pose, self.first = pose.moved(-self.origin), first.moved(-self.origin)
        positions = positions - self.origin
        self.held = held = [putting_on.held_by(scene, a, self.pose, positions) for a in scene.attachments]
        require_held_once(held)
        self.assembly = assemble(scene, held, threads=threads, spare=solver.splits, hands=hands)
        self.holding = np.unique(np.concatenate([np.empty(0, np.int64), *(a.bones for a in self.assembly.carried)]))
        self.state = State.at_rest(self.assembly.inwards(positions), solver.dtype(self.assembly))
        self._begin()
        self.ways = [
            (attached, *putting_on.hold_points(scene, attached, own, self.pose, positions))
            for attached, own in self.assembly.carried_with(held)
        ]
        self._animate(positions)
        self._center, self.strained = np.zeros(3), False
        self.time, self.weather, self.keeps_journal = 0.0, Weather(self.assembly), False
        self.journal: Journal | None = None

    def _animate(self, positions: FloatArray) -> None:
        """Have bones carry along, from where the cloth is put on (V, 3), where confined vertices are to be near."""
        confined, scene = self.assembly.confined, self.assembly.scene
        if confined is None:
            return
        animated = [(each.animated, each.animated.vertices) for each in scene.confinements]
        self.ways.append(
            (confined.animated, *putting_on.hold_points(scene, confined.animated, animated, self.pose, positions))
        )
        confined.normals[:] = putting_on.normals_in_bones(scene, confined.animated, animated, self.pose, positions)

    @property
    def positions(self) -> FloatArray:
        """Positions of the vertices in the world [m], shape (V, 3)."""
        return self.assembly.outwards(np.stack(self.state[:3], axis=1).astype(float)) + self.origin

    @property
    def velocities(self) -> FloatArray:
        """Velocities of the vertices [m/s], shape (V, 3)."""
        return self.assembly.outwards(np.stack(self.state[3:], axis=1).astype(float))

    @property
    def _pinched(self) -> NDArray[np.bool_]:
        colliders = self.assembly.contacts.colliders
        return np.zeros(0, np.bool_) if colliders is None else colliders.pinched

    @property
    def haste(self) -> float:
        """How many times too long steps were for thin colliders that came by."""
        faces = self.assembly.contacts.faces
        return 0.0 if faces is None else float(faces.haste[0])

    def choose_substeps(self, dt: float, *, strained: bool = False) -> int:
        """Substeps in `dt` [s] that were asked for, or that the solver chooses.

        Raises:
            ValueRangeError: they are more than `MOST_SUBSTEPS`.
        """
        substeps = self._solver.choose_substeps(self.running, dt, strained=strained)
        if substeps > MOST_SUBSTEPS:
            raise ValueRangeError(
                f"{self._solver.name} would need {substeps:.3g} steps a frame here, more than {MOST_SUBSTEPS}: use a "
                "softer, heavier or less damped fabric, a wider spacing, or another solver (xpbd, tr_bdf2)"
            )
        return substeps

    def own_choice(self, dt: float, *, strained: bool = False) -> int:
        """Substeps in `dt` [s] that the solver would choose, whatever was asked for."""
        return replace(self._solver, substeps=None).choose_substeps(self.running, dt, strained=strained)

    def toward_limit(self, dt: float, substeps: int) -> Solver:
        """What leads soonest to where shorter steps would lead than `substeps` in `dt` [s]."""
        return self._solver.toward_limit(self.running, dt, substeps)

    def change_solver(self, solver: Solver) -> None:
        """Go on with another solver from where the cloth is."""
        if not solver.steps_as(self._solver, self.running):
            dtype = solver.dtype(self.assembly)
            self.state = State(*(component.astype(dtype) for component in self.state))
            self._solver = solver
            self._begin()
        self._solver = solver

    def _begin(self) -> None:
        """Set out with the solver and the state that there are."""
        self.running = self._solver.init(self.assembly, self.state)
        self._sound, self._slow = (Bound(whereabouts, *self.state, FARTHEST_LEAP, most) for most in (FASTEST, WILD))
        self.limit = StrainLimit(self.assembly, self.state, self.running.limits)
        self.slips = Slips(self.assembly, self.state)
        self._strain = strain_check(self.assembly.springs, self.state, STRAINED)

    def follow(self, assembly: Assembly, changed: "Changed") -> None:
        """Go on in the assembly of a mesh that has split, in place; see `Solver.follow`."""
        self.running.arrays = self._solver.follow(self.running.arrays, assembly, changed)
        self.assembly = self.running.assembly = assembly
        self.slips = Slips(assembly, self.state)

    @property
    def follow_requests(self) -> list[Request]:
        """The code that `follow` needs, to be compiled together with other code."""
        return self._solver.follow_requests(self.running.arrays)

    def begin_in(self, assembly: Assembly, state: State) -> None:
        """Set out in another assembly of the same scene, or one of more vertices, at a state about the same origin."""
        self.assembly, self.state, self.weather = assembly, state, Weather(assembly)
        self._begin()
        self.aim()

    def requests(self, *, keeps_journal: bool = False) -> list[Request]:
        """The code that a run needs, to be compiled together with other code."""
        journals = [None, self._blank_journal(1)] if keeps_journal else [None]
        return [
            *(r for j in journals for r in self._solver.requests(self.running, self._threads, j)),
            self._sound.request,
            self._strain.request,
            *self.limit.requests,
        ]

    def prepare(self) -> None:
        """Make the programs of a frame, and compile or load what they need, so that the first one takes no longer."""
        self._solver.prepare(self.running, self._threads)

    def blow(self, pose: Pose, duration: float, *, against: FloatArray | float = 0.0) -> None:
        """Have the wind blow as it does in a frame of `duration` [s] in which the bones move to a pose.

        It comes as if all moved on at a velocity `against` it [m/s].

        Raises:
            ValueRangeError: the field of the wind gives no finite velocities.
        """
        stream = self.assembly.stream
        if stream is not None:
            self.weather.blow(self.state, self.origin, (self.pose, pose), self.time, duration)
            for velocities in (stream.begin, stream.end):
                velocities -= np.reshape(against, (-1, 1))

    def set_out(self, velocity: FloatArray, spin: FloatArray) -> None:
        """Give the cloth the velocity [m/s] and spin [rad/s] of what holds it, as if it were rigid."""
        carrying = [attached.bones for attached in self.assembly.carried]
        if not carrying:
            return
        center = self.origin + self.pose.positions[np.concatenate(carrying)].mean(axis=0)
        carried = velocity + np.cross(spin, self.positions - center)
        for component, added in zip(self.state[3:], self.assembly.inwards(carried.astype(float)).T, strict=True):
            component += added

    def disturb(self, offsets: FloatArray) -> None:
        """Move the vertices that no bone holds by `offsets` [m], shape (V, 3)."""
        free = self.assembly.inverse_mass > 0.0
        for component, moved in zip(self.state[:3], self.assembly.inwards(offsets).T, strict=True):
            component[free] += moved[free].astype(component.dtype)
        self.look()

    def draw(self, positions: FloatArray, velocities: FloatArray, share: float) -> None:
        """Take what no bone holds a share of the way to positions [m] and velocities [m/s] of the world, (V, 3)."""
        free = self.assembly.inverse_mass > 0.0
        goals = self.assembly.inwards(np.column_stack([positions - self.origin, velocities]))
        for component, goal in zip(self.state, goals.T, strict=True):
            component[free] += (share * (goal[free] - component[free])).astype(component.dtype)
        self.look()

    def place(self) -> Place:
        """Where the cloth is, for another one of the same scene."""
        state = np.stack(self.state, axis=1).astype(float)
        return Place(self.origin, self.pose, self.assembly.outwards(state), self._hold(), self.time)

    def _hold(self) -> tuple[Hold, ...]:
        """A copy of how bones carry what they carry."""
        return tuple((c.points.copy(), c.lift.copy(), c.drift.copy()) for c in self.assembly.carried)

    def _hold_again(self, hold: tuple[Hold, ...]) -> None:
        """Put it back."""
        for carried, kept in zip(self.assembly.carried, hold, strict=True):
            carried.points[:], carried.lift[:], carried.drift[:] = kept
        self.aim()

    def aim(self) -> None:
        """Set where springs hold vertices to where the bones are."""
        pull = self.assembly.pull
        if pull is not None:
            pull.goals[:], pull.speeds[:] = putting_on.held_points(pull.attached, self.pose).T, 0.0

    def go_to(self, place: Place) -> None:
        """Take the place, speed and hold of another one of the same scene; what layers and limbs hold is found anew."""
        self.origin, self.pose, self.time = place.origin, place.pose, place.time
        for component, values in zip(self.state, self.assembly.inwards(place.state).T, strict=True):
            component[:] = values
        self._pinched[:], self.slips.of_vertices[:] = False, NOT
        self.running.drawn.by[:], self.limit.acts = 0.0, True
        self._hold_again(place.hold)
        self.look()

    def can_be_carried(self, pose: Pose) -> bool:
        """Tell whether the cloth, carried to where the bones have jumped, would go on as it was.

        That is: what bones hold has not parted, and no vertex is in a limb deeper than cloth is stopped before one, or
        than it was before; limbs that had to throw it out would tear at it.
        """
        scene = self.assembly.scene
        if not self.assembly.carried:
            return True
        before, after = (self._held_points(each) for each in (self.pose, pose))
        rotation, shift = rigid_motion(before, after)
        parted = np.linalg.norm(before @ rotation.T + shift - after, axis=1).max()
        if parted > PARTED * np.linalg.norm(before - before.mean(axis=0), axis=1).max():
            return False
        places = np.stack(self.state[:3], axis=1)[self.assembly.inverse_mass > 0.0].astype(float)
        allowed = max(scene.thickness, putting_on.depth_in_colliders(scene, self.pose, places))
        return putting_on.depth_in_colliders(scene, pose, places @ rotation.T + shift) <= allowed

    def carry(self, pose: Pose) -> None:
        """Move the cloth as a whole to where the bones have jumped, to a pose about `origin`."""
        attached = self.assembly.attached
        if self.assembly.carried:
            before = self._held_points(self.pose)
            rotation, shift = rigid_motion(before, self._held_points(pose))
            moved = self._turn(rotation, shift)
            pose = pose.moved(-moved)
            if attached is not None:
                # How the jump has changed the bones' places to each other is caught up with slowly.
                carried = before[: len(attached.vertices)] @ rotation.T + shift - moved
                putting_on.lift_to(attached, pose, carried)
        self.pose = pose
        self.running.drawn.by[:] = 0.0
        self.aim()
        self.look()

    def move(self, rotation: FloatArray, shift: FloatArray, pose: Pose) -> None:
        """Move the cloth and its bones as a whole, by a turn (3, 3) about the world's origin and then a shift [m] (3,).

        `pose` is where the bones are then, about `origin`.
        """
        moved = self._turn(rotation, rotation @ self.origin + shift - self.origin)
        self.pose = pose.moved(-moved)
        self.aim()
        self.look()

    def _turn(self, rotation: FloatArray, shift: FloatArray) -> FloatArray:
        """Turn the cloth about `origin` and then shift it [m]; gives how far the origin has come along [m], (3,)."""
        places = np.stack(self.state[:3], axis=1) @ rotation.T + shift
        velocities = np.stack(self.state[3:], axis=1) @ rotation.T
        moved = np.round(places.mean(axis=0))
        for component, values in zip(self.state, (*(places - moved).T, *velocities.T), strict=True):
            component[:] = values
        self.origin = self.origin + moved
        if self.assembly.layers is not None:
            self_contact.turn(self.assembly.layers, rotation)
        return moved

    def _held_points(self, pose: Pose) -> FloatArray:
        """Where bones hold vertices at a pose [m], hard ones first, shape (n, 3)."""
        return np.concatenate([putting_on.held_points(attached, pose) for attached in self.assembly.carried])

    def complete(self, motion: Motion, duration: float, substeps: int, before: Moment) -> tuple[int, bool]:
        """Advance a frame, again from the moment before it where pairs of layers had no room in their lists.

        Returns how many solves did not converge, and whether the result is sound.
        """
        while True:
            unconverged = self.advance(motion, duration, substeps)
            known, sound = self.assembly.layers, self.look()
            if known is None or self_contact.surplus(known) == 0:
                return unconverged, sound
            if not sound or not self_contact.may_grow(known):
                return unconverged, False
            self.assembly = self.assembly.with_layers(self_contact.enlarged(known))
            self.running.go_on_with(self.assembly)
            self.restore(before)

    def advance(self, motion: Motion, duration: float, substeps: int) -> int:
        """Advance by `duration` [s], and tell how many solves did not converge."""
        if self.keeps_journal:
            self.journal = self._blank_journal(substeps)
        unconverged = self._solver.step(
            self.running, motion, duration=duration, substeps=substeps, threads=self._threads, journal=self.journal
        )
        self.assembly.carry_spares(self.state)
        return unconverged

    def _blank_journal(self, substeps: int) -> Journal:
        count, dtype = self.state.x.size, self.state.x.dtype
        integrated, ended = np.empty((2, substeps, 6, count), dtype)
        unlimited = np.empty_like(ended) if self.assembly.scene.strain_limit else None
        pull = self.assembly.pull
        goals = None if pull is None else np.empty((substeps + 1, 6, pull.stiffness.size))
        return Journal(integrated, unlimited, ended, np.empty((substeps, count), np.bool_), goals)

    def lead(self, share: float) -> None:
        """Have what bones hold be a share of the way from where it starts to where it is worn."""
        for attached, worn, spread in self.ways:
            attached.points[:] = spread + share * (worn - spread)

    def note_lift(self, duration: float) -> None:
        """Note how far what bones hold has drifted out of colliders in a frame of `duration` [s]."""
        attached = self.assembly.attached
        if attached is not None:
            attached.lift[:] += duration * attached.drift

    def recenter(self) -> None:
        """Keep the cloth near the origin that its positions refer to: far from it single precision is coarse."""
        if np.abs(self._center).max() < FARTHEST:
            return
        shift = np.round(self._center).astype(float)
        for component, moved in zip(self.state[:3], shift, strict=True):
            component -= component.dtype.type(moved)
        self.origin = self.origin + shift
        self.pose = self.pose.moved(-shift)
        self.aim()

    def look(self) -> bool:
        """Tell whether no vertex is farther or faster than anything real.

        Notes where the cloth is, and whether it is strained.
        """
        *center, sound = self._sound()
        self._center = np.array(center)
        self.strained = bool(self._strain())
        return sound

    def whirls(self) -> bool:
        """Tell whether any vertex is faster than most motions make it; few are, and the step is then worth a check."""
        *_, slow = self._slow()
        return not slow

    def moment(self) -> Moment:
        """A copy of what a frame changes."""
        known = self.assembly.layers
        kept = None if known is None else self_contact.keep(known)
        state, pinched, drawn = tuple(c.copy() for c in self.state), self._pinched.copy(), self.running.drawn.by.copy()
        return Moment(
            state, kept, pinched, self.slips.of_vertices.copy(), drawn, self.limit.idle, self.limit.lasting,
            self._center, self.strained,
        )  # fmt: skip

    def restore(self, before: Moment) -> None:
        """Put a moment back."""
        for component, kept in zip(self.state, before.state, strict=True):
            component[:] = kept
        self._center, self.strained = before.center, before.strained
        self._pinched[:], self.slips.of_vertices[:] = before.pinched, before.slips
        self.running.drawn.by[:] = before.drawn
        self.limit.idle, self.limit.lasting = before.idle, before.lasting
        if self.assembly.layers is not None and before.layers is not None:
            self_contact.put_back(self.assembly.layers, before.layers)

    def frame(self) -> Frame:
        """A copy of all that the cloth goes on from."""
        return Frame(self.moment(), self.origin, self.pose, self._hold(), self.time)

    def go_back_to(self, frame: Frame) -> None:
        """Put all that back, in the precision of the solver that there is now.

        It may be from another one of the same scene, on as many threads.
        """
        known, kept = self.assembly.layers, frame.moment.layers
        if known is not None and kept is not None:
            roomy = self_contact.with_room_for(known, kept)
            if roomy is not known:
                self.assembly = self.assembly.with_layers(roomy)
                self.running.go_on_with(self.assembly)
        self.restore(frame.moment)
        self.origin, self.pose, self.time = frame.origin, frame.pose, frame.time
        self._hold_again(frame.hold)

    @contextmanager
    def taken_back(self) -> Iterator[Moment]:
        """Keep a copy of the state, and put it back should anything be raised within."""
        before = self.moment()
        try:
            yield before
        except BaseException:
            self.restore(before)
            raise
