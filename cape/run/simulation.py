"""A cloth that is being simulated: put on, settled, and stepped along with its bones."""

import math
import time

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cape.air.wind import Wind
from cape.assembly.assemble import Assembly
from cape.kernels import store
from cape.kernels.bones import Motion
from cape.kernels.state import State
from cape.kernels.store import Request
from cape.measure.energy import Energy, energy_of
from cape.measure.ledger import Ledger
from cape.measure.meter import Meter, Reading
from cape.run.attempts import SETTLING_FRAME, bring_to_rest, diverged, take_frame
from cape.run.by_hand.hands import ByHand
from cape.run.hanging import Hanging
from cape.run.tearing.simulation import tearable
from cape.run.tearing.tears import Tears
from cape.run.whereabouts import Forecast, Mark, Snapshot
from cape.scene.jumps import Cuts
from cape.scene.poses import Bones, Pose, read_pose, read_vector
from cape.scene.scene import Scene
from cape.solvers import Solver, SymplecticEuler
from cape.solvers.threads import threads_for
from motions import quaternions
from motions.border import checked_first
from motions.errors import ValueRangeError, require_whole

FloatArray = NDArray[np.float64]

MOST_THREADS = 1024
FORECAST_SUBSTEPS = 50
DEFAULT_CUTS = Cuts()


@checked_first
class Simulation(ByHand):
    """A running cloth for one's own loop: `start` once with the first pose, then `step` for each new one.

    Bones are given as a mapping from each name in `scene.bones` to (position [m], quaternion bone_to_world wxyz), or as
    a `Pose` in the order of `bones`.

    Attributes:
        scene: cloth, attachments, colliders, forces.
        solver: how it is advanced.
        threads: how many share the cloth at most.
        substeps: steps of the last frame, as chosen first; after `compile`, of the frames in which the cloth settles.
        retried: frames since the start that exploded and were done again in shorter steps.
        refined: frames that were taken in shorter steps, as the longer ones did not converge, made parts whirl,
            strained springs too far, or let thin colliders come by too far; those are not counted that only a limit of
            strain needed.
        troubled: those of them whose longer steps did not converge, or made parts whirl.
        unconverged: frames that did not converge in shorter steps either.
        cuts: what counts as a jump of the bones, and what becomes of the cloth; None to take all as motion.
        jumps: frames in which the bones have jumped.
        renewed: those of them in which the cloth was put on anew.
        ledger: where the energy is accounted for, None for nowhere.
    """

    def __init__(
        self,
        scene: Scene,
        *,
        solver: Solver | None = None,
        threads: int | None = None,
        cuts: Cuts | None = DEFAULT_CUTS,
        ledger: Ledger | None = None,
        hands: int = 0,
    ) -> None:
        """Hold the scene and the solver; nothing is computed before `start`.

        Args:
            scene: cloth, attachments, colliders, forces.
            solver: None for symplectic Euler with the step that the scene needs.
            threads: how many share the cloth, None for as many as pay off; the results are the same.
            cuts: what counts as a jump of the bones, and what becomes of the cloth; None to take all as motion.
            ledger: of this simulation alone, to account for its energy from each start on.
            hands: how many may take hold of the cloth as it runs, see `take_hold`; none cost nothing.

        Raises:
            ValueRangeError: the number of threads is not positive, or there are hands, whose work no ledger knows.
        """
        if threads is not None:
            require_whole("threads", threads, 1, MOST_THREADS)
        if hands and ledger is not None:
            raise ValueRangeError("a ledger does not know what hands do: leave out one of them")
        solver = solver or SymplecticEuler()
        super().__init__(tearable(scene, solver), solver, hands=hands)
        self.threads = threads or threads_for(scene.cloth.vertices)
        self.substeps = 0
        self.retried = 0
        self.refined = self.troubled = 0
        self.unconverged = 0
        self.cuts = cuts
        self.jumps = self.renewed = 0
        self.ledger = ledger

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
        return self._started.assembly

    @property
    def positions(self) -> FloatArray:
        """Positions of the vertices in the world [m], shape (V, 3)."""
        return self._started.positions

    @property
    def velocities(self) -> FloatArray:
        """Velocities of the vertices [m/s], shape (V, 3)."""
        return self._started.velocities

    @property
    def energy(self) -> Energy:
        """Energies of the cloth as it is now [J]."""
        cloth = self._started
        return energy_of(cloth.assembly, cloth.state, cloth.origin)

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
        moving, turning = read_vector(velocity, "velocity at the start"), read_vector(spin, "spin at the start")
        if settle is not None and not 0.0 <= settle < math.inf:
            raise ValueRangeError(f"settle must be zero or more seconds, not {settle}")
        self.substeps = self.retried = self.refined = self.troubled = self.unconverged = self.jumps = self.renewed = 0
        self._put_on(read_pose(bones, self.bones), settle, moving, turning)
        self._open_ledger()

    def snapshot(self) -> Snapshot:
        """Where the cloth is now, for `start_from`.

        Raises:
            ValueRangeError: the simulation has not been started, or the cloth has torn.
        """
        self._require_whole()
        place = self._started.place()
        return Snapshot(self.scene, self._first_pose, place)

    def start_from(self, snapshot: Snapshot) -> None:
        """Start from where this or another simulation of the same scene was: its bones, positions and velocities.

        What layers of the cloth then touch each other, and what limbs pinch, is found anew.

        Raises:
            ValueRangeError: the snapshot is of another scene, or the cloth has torn.
        """
        if snapshot.scene is not self.scene:
            raise ValueRangeError("a simulation starts from a snapshot of its own scene only")
        self._require_whole()
        self.substeps = self.retried = self.refined = self.troubled = self.unconverged = self.jumps = self.renewed = 0
        cloth = self._cloth or self._put_on(snapshot.first_pose, 0.0)
        cloth.go_to(snapshot.place)
        self._open_ledger()

    def disturb(self, offsets: ArrayLike) -> None:
        """Move the vertices that no bone holds by `offsets` [m], shape (V, 3), velocities as they are.

        Raises:
            ValueRangeError: the simulation has not been started, or the shape is another, or a number is not finite.
        """
        cloth = self._started
        moves = np.asarray(offsets, dtype=float)
        if moves.shape != cloth.positions.shape or not np.isfinite(moves).all():
            raise ValueRangeError(f"offsets must be finite and of shape {cloth.positions.shape}")
        cloth.disturb(moves)

    def draw(self, positions: ArrayLike, velocities: ArrayLike, share: float) -> None:
        """Take the vertices that no bone holds a share of the way to a state in the world.

        Args:
            positions: of all vertices [m], shape (V, 3).
            velocities: of all of them [m/s], shape (V, 3).
            share: 0 for none of the way, 1 for all of it.

        Raises:
            ValueRangeError: the simulation has not been started, or the shape is another, or a number is not finite.
        """
        cloth = self._started
        state = np.asarray(positions, dtype=float), np.asarray(velocities, dtype=float)
        if any(each.shape != cloth.positions.shape or not np.isfinite(each).all() for each in state):
            raise ValueRangeError(f"positions and velocities must be finite and of shape {cloth.positions.shape}")
        cloth.draw(*state, share)

    def mark(self) -> Mark:
        """All that this simulation goes on from, for `go_back`.

        Raises:
            ValueRangeError: it has not been started, or the cloth has torn.
        """
        self._require_whole()
        counts = self.substeps, self.retried, self.refined, self.troubled, self.unconverged, self.jumps, self.renewed
        return Mark(self._started.frame(), self.solver, counts)

    def go_back(self, mark: Mark) -> None:
        """Be where this simulation, or another one of its scene, was, and know what it knew, in the steps taken now.

        Raises:
            ValueRangeError: the cloth has torn since.
        """
        self._require_whole()
        self._started.go_back_to(mark.frame)
        (
            self.substeps, self.retried, self.refined, self.troubled, self.unconverged, self.jumps, self.renewed
        ) = mark.counts  # fmt: skip

    def change_solver(self, solver: Solver) -> None:
        """Go on with another solver, or another number of its substeps, from where the cloth is.

        Raises:
            ValueRangeError: the simulation has not been started, a ledger keeps the accounts of its solver, or the
                cloth may tear and is a grid, which only symplectic Euler steps then.
        """
        if tearable(self.scene, solver) is not self.scene:
            raise ValueRangeError(f"a grid that may tear was set out with {self.solver.name}: it can't go on otherwise")
        if self.ledger is not None:
            raise ValueRangeError("a ledger keeps the accounts of one solver, which can't be changed")
        self._go_on_with(solver)

    def turn_wind(self, wind: Wind) -> None:
        """Have another wind of the same air blow from now on.

        Raises:
            ValueRangeError: the simulation has not been started, or its scene has no air, or a steady wind to keep.
        """
        self._started.weather.turn_to(wind)

    def toward_limit(self, dt: float, substeps: int) -> Solver:
        """What leads soonest to where ever shorter steps would lead than `substeps` in `dt` [s], and how many of them
        to begin with.

        Raises:
            ValueRangeError: the simulation has not been started.
        """
        return self._started.toward_limit(dt, substeps)

    def compile(self, bones: Bones, *, measured: Scene | None = None) -> None:
        """Compile all that a run needs which is not kept yet, on all cores at once, and load it.

        Args:
            bones: the first pose.
            measured: the scene that is given to `meter`, None for the simulation's own.

        Raises:
            UnknownNameError: a bone's pose is missing.
            ValueRangeError: a pose isn't finite, the cape can't be put on, or a vertex is held twice.
        """
        store.load(self.requests(bones, measured=measured))

    def requests(self, bones: Bones, *, measured: Scene | None = None) -> list[Request]:
        """What `compile` asks for, for several simulations to be compiled together: see `kernels.store.prepare`."""
        pose = read_pose(bones, self.bones)
        found: dict[Request, None] = {}
        for solver in self._solvers:
            cloth = Hanging(self.scene, solver, pose, threads=self.threads, hands=self._hands)
            if solver is self.solver:
                self.substeps = cloth.choose_substeps(SETTLING_FRAME)
            found |= dict.fromkeys(cloth.requests(keeps_journal=self.ledger is not None))
            found |= dict.fromkeys(Meter(cloth.assembly, measured).requests(cloth.state))
            if self.scene.tearing is not None:
                found |= dict.fromkeys(Tears(cloth).requests(cloth))
            if self.ledger is not None:
                found |= dict.fromkeys(self.ledger.requests(cloth.assembly, cloth.state))
        return list(found)

    @property
    def _is_fixed(self) -> bool:
        """Whether the number of substeps was asked for."""
        return self.solver.substeps is not None

    @property
    def _solvers(self) -> tuple[Solver, ...]:
        """The solvers that a run may use."""
        return (self.solver,)

    def move(self, position: ArrayLike, rotation_wxyz: ArrayLike = (1.0, 0.0, 0.0, 0.0)) -> None:
        """Move the cloth and its bones as a whole: turned about the world's origin, then shifted.

        It goes on from there as it was, shape and speeds turned with it. What stands in the world stays where it is.

        Args:
            position: the shift [m], shape (3,).
            rotation_wxyz: unit quaternion (w, x, y, z), shape (4,).

        Raises:
            ValueRangeError: the simulation has not been started, a number is not finite, or the quaternion is zero.
        """
        cloth = self._started
        here = Pose(*cloth.pose).moved(cloth.origin).without_world()
        shift = read_vector(position, "position")
        there = read_pose(here.turned(np.asarray(rotation_wxyz, dtype=float)).moved(shift), self.bones)
        turn = quaternions.normalize(np.asarray(rotation_wxyz, dtype=float))
        cloth.move(quaternions.to_matrix(turn), shift, there.moved(-cloth.origin))

    def step(self, bones: Bones, dt: float, *, jumped: bool = False) -> None:
        """Advance the cloth by `dt` [s], in which the bones move from where they were to the given pose.

        Starts the simulation with that pose if it has not been started. A step that explodes is taken back and done
        again with half the step, or as small a one as the solver would have chosen.

        Args:
            bones: the pose at the end of the step.
            dt: its length [s].
            jumped: whether the bones have jumped to that pose, however near it is; otherwise `cuts` tells.

        Raises:
            UnknownNameError: a bone's pose is missing.
            ValueRangeError: the pose is not finite, or `dt` is not positive.
            Diverged: the step explodes at any size; the state is as before.
        """
        if not 0.0 < dt < float("inf"):
            raise ValueRangeError(f"the time step must be positive and finite, not {dt}")
        if self._cloth is None:
            self.start(bones)
        cloth = self._started
        cloth.recenter()
        pose = read_pose(bones, self.bones)
        cuts = self.cuts or DEFAULT_CUTS if jumped else self.cuts
        if cuts is not None and (jumped or cuts.between(cloth.pose, pose.moved(-cloth.origin), dt, cloth.holding)):
            self.jumps += 1
            cloth = self._jump(pose, cuts)
        self._move_on_and_tear(pose.moved(-cloth.origin), dt)

    def _move_on(self, pose: Pose, dt: float, substeps: int) -> None:
        """Take a frame of `dt` [s], or a part of one, to a pose about the cloth's origin."""
        cloth = self._started
        cloth.blow(pose, dt)
        with cloth.taken_back() as before:
            taken = take_frame(cloth, Motion(*cloth.pose, *pose), dt, substeps, before, fixed=self._is_fixed)
        self.retried += taken.exploded
        self.refined += taken.refined
        self.troubled += taken.troubled
        self.unconverged += taken.unconverged
        cloth.pose = pose
        cloth.time += dt
        self._move_hands(dt)
        if self.ledger is not None and cloth.journal is not None:
            self.ledger.enter(cloth.assembly, State(*before.state), cloth.origin, cloth.journal, dt)

    def _open_ledger(self) -> None:
        """Begin to account for the energy of the cloth as it is, where there is a ledger."""
        cloth = self._started
        if self.ledger is not None:
            self.ledger.begin(cloth.assembly, cloth.state, cloth.origin, sweeps=self.solver.sweeps)

    def _put_on(
        self,
        pose: Pose,
        settle: float | None,
        moving: FloatArray | float = 0.0,
        turning: FloatArray | float = 0.0,
        time: float = 0.0,
    ) -> Hanging:
        """Put the cloth on bones at a pose, to set out with a velocity [m/s] and a spin [rad/s], shape (3,) each.

        `time` [s] is since the bones left their first pose.
        """
        self._let_go_of_all()
        self._cloth, self._first_pose = None, pose
        cloth = Hanging(self.scene, self.solver, pose, threads=self.threads, hands=self._hands)
        cloth.time = time
        bring_to_rest(cloth, settle, np.broadcast_to(moving, 3))
        cloth.set_out(np.broadcast_to(moving, 3), np.broadcast_to(turning, 3))
        if not cloth.look():
            raise diverged(cloth.own_choice(SETTLING_FRAME))
        cloth.prepare()
        cloth.keeps_journal = self.ledger is not None
        self._cloth = cloth
        self._tears = None if self.scene.tearing is None else Tears(cloth)
        return cloth

    def _jump(self, pose: Pose, cuts: Cuts) -> Hanging:
        """Carry the cloth along to where the bones have jumped, or put it on anew there."""
        cloth = self._started
        worn = self.scene.cloth.frame == "wearer"
        if cuts.then == "reset" or (worn and not cloth.can_be_carried(pose.moved(-cloth.origin))):
            self.renewed += 1
            if worn:
                return self._put_on(pose, None, time=cloth.time)
            # A cloth that started in the world did so where the first pose of its bones was.
            cloth = self._put_on(self._first_pose, None, time=cloth.time)
        cloth.carry(pose.moved(-cloth.origin))
        return cloth

    def forecast(self, dt: float, bones: Bones | None = None) -> Forecast:
        """Tell what a frame of `dt` [s] takes, by stepping a part of one and taking it back.

        With `bones`, a first pose, it is one of a cloth that is only laid out: the simulation need not be started.

        Raises:
            ValueRangeError: the simulation has not been started, or the cape can't be put on.
        """
        if bones is None:
            cloth = self._started
        else:
            pose = read_pose(bones, self.bones)
            cloth = Hanging(self.scene, self.solver, pose, threads=self.threads, hands=self._hands)
            cloth.lead(0.0)
        substeps = cloth.choose_substeps(dt)
        tried = min(substeps, FORECAST_SUBSTEPS)
        seconds = []
        with cloth.taken_back() as before:
            for _ in range(2):
                begun = time.perf_counter()
                cloth.complete(Motion(*cloth.pose, *cloth.pose), dt * tried / substeps, tried, before)
                seconds.append((time.perf_counter() - begun) * substeps / tried)
                cloth.restore(before)
        return Forecast(substeps, min(seconds))

    def meter(self, scene: Scene | None = None) -> Meter:
        """Give a meter for this run, of the colliders of another scene of the same cloth where one is given."""
        return Meter(self.assembly, scene)

    def read(self, meter: Meter, bones: Bones | None = None) -> Reading:
        """Measure the cloth as it is now; a meter of another scene needs the poses of that scene's bones."""
        cloth = self._started
        meter.follow(cloth.assembly)
        pose = cloth.pose if bones is None else read_pose(bones, meter.scene.bones).moved(-cloth.origin)
        return meter.read(cloth.state, pose, origin=cloth.origin)
