"""What every solver is."""

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np

from cape.assembly.assemble import Assembly
from cape.assembly.contact import link_distances
from cape.kernels.bones import Motion
from cape.kernels.linking import Frame, Linker, arrivals_for
from cape.kernels.solve.journal import Journal
from cape.kernels.state import State
from cape.kernels.store import Request
from cape.kernels.team import Team, span
from cape.solvers import threads as teams
from cape.solvers.order import Order
from cape.solvers.running import Running, Thread
from motions.border import checked
from motions.errors import ValueRangeError, require_whole

if TYPE_CHECKING:
    from cape.assembly.mesh.split_springs import Changed

Precision = Literal["single", "double"]

MOST_ITERATIONS = 1_000_000  # of any kind in a step
GRIP = 1000.0  # N/m with which a hand holds a vertex: it gives way by a millimetre to a newton
MOST_SUBSTEPS = 1_000_000  # in a frame, asked for or chosen, which then takes half a minute for a small cloth


@checked
@dataclass(frozen=True, kw_only=True)
class Solver(ABC):
    """How a cloth is advanced by one frame; holds settings alone, never the state of a run.

    Attributes:
        substeps: steps in each frame, None to let the solver choose.
        precision: of the cloth's positions and velocities; None to let the solver choose.
        usual_precision: what it chooses, unless a scene needs another.
        order: power of the step by which errors shrink, in theory, once steps are short enough.
        splits: whether it steps meshes with spare vertices, which may split while it runs.
        splits_grids: whether it steps such grids.
        sweeps: whether springs act by impulses that are found in sweeps over them, rather than by their forces.
        rounds: whether contact and limits of strain act on a copy of its state in single precision.
        title: what it is called in tables and pictures.
        colour: that pictures draw it in.
        measured_steps: numbers of steps in a frame that a report measures; empty for multiples of its own choice.
        cost_growth: power of its steps that their cost grows by, less than 1 where short steps are solved sooner.
    """

    name: ClassVar[str]
    title: ClassVar[str]
    colour: ClassVar[str] = "#777777"
    measured_steps: ClassVar[tuple[int, ...]] = ()
    cost_growth: ClassVar[float] = 1.0
    usual_precision: ClassVar[Precision]
    order: ClassVar[float]
    splits: ClassVar[bool] = False
    splits_grids: ClassVar[bool] = False
    sweeps: ClassVar[bool] = False
    rounds: ClassVar[bool] = False
    substeps: int | None = None
    precision: Precision | None = None

    def __post_init__(self) -> None:
        """Check the settings.

        Raises:
            ValueRangeError: the number of substeps is not positive, or the precision is unknown.
        """
        if self.substeps is not None:
            require_whole("substeps", self.substeps, 1, MOST_SUBSTEPS)
        if self.precision not in ("single", "double", None):
            raise ValueRangeError(f"precision must be single or double, not {self.precision!r}")

    def dtype(self, assembly: Assembly) -> type[np.floating]:
        """The precision for a scene, as a numpy type: as asked, or the usual one."""
        return np.float32 if (self.precision or self.usual_precision) == "single" else np.float64

    def steps_as(self, other: "Solver", running: Running) -> bool:
        """Tell whether it steps what another solver has made as that does, but for the number of steps."""
        return replace(self, substeps=None) == replace(other, substeps=None)

    def toward_limit(self, running: Running, duration: float, substeps: int) -> "Solver":
        """What leads soonest to where ever shorter steps of this solver would lead, with steps to begin with.

        Where its own, of which it takes `substeps` in a frame of `duration` [s], are as good as any, it is itself, in
        twice as many.
        """
        return self.in_steps(2 * substeps, duration)

    def in_steps(self, substeps: int, duration: float) -> "Solver":
        """The same method with so many steps in a frame of `duration` [s], in a precision that does for them."""
        return replace(self, substeps=substeps)

    def init(self, assembly: Assembly, state: State) -> Running:
        """Prepare to step a cloth from a state, in the solver's precision, which steps change in place."""
        return Running(assembly, state, self.arrays(assembly), rounded=self.rounds)

    @abstractmethod
    def arrays(self, assembly: Assembly) -> Any:
        """The arrays that the steps of one run share: at least `inertia`, and those of `forces` by kind."""

    @abstractmethod
    def choose_substeps(self, running: Running, duration: float, *, strained: bool = False) -> int:
        """Number of steps in a frame of `duration` [s], also of a cloth that is strained far."""

    @abstractmethod
    def units(self, thread: Thread, linker: Linker) -> Order:
        """What one thread does in a frame; programs within programs are made by the linker."""

    def grip(self, running: Running, mass: float) -> tuple[float, float]:
        """Stiffness [N/m] and damping [N s/m] with which a hand holds a vertex of some mass [kg]."""
        return GRIP, 2.0 * math.sqrt(GRIP * mass)

    def follow(self, arrays: Any, assembly: Assembly, changed: "Changed") -> Any:
        """The arrays for a mesh that has split, with what has changed; only those that `splits` follow, in place.

        Raises:
            NoRoom: what has split finds no room, and the arrays are of no use any more.
        """
        raise NotImplementedError

    def follow_requests(self, arrays: Any) -> list[Request]:
        """The code that `follow` needs; none, for most solvers."""
        return []

    def begin(self, running: Running) -> None:  # noqa: B027
        """Prepare for a frame; nothing, for most solvers."""

    def unconverged(self, running: Running) -> int:
        """How many solves within the last frame did not reach the solver's tolerance, 0 for explicit methods."""
        return 0

    def step(
        self,
        running: Running,
        motion: Motion,
        *,
        duration: float,
        substeps: int,
        threads: int = 1,
        journal: Journal | None = None,
    ) -> int:
        """Advance the state in place by a frame of `duration` [s], while the bones move as `motion` tells.

        `threads` is at most the number of the assembly's ranks; it never changes the result. Nor does a `journal`, with
        room for all substeps, which is filled with what each of them did.

        Returns:
            How many solves within the frame did not reach the solver's tolerance.
        """
        for kept, given in zip(running.motion, motion, strict=True):
            kept[:] = given
        running.duration[0] = duration
        self.begin(running)
        programs = self._programs(running, threads, journal)
        programs.run(substeps, duration)
        return self.unconverged(running)

    def requests(self, running: Running, threads: int = 1, journal: Journal | None = None) -> list[Request]:
        """The code that steps need, to be compiled together with other code; none once they have it."""
        return self._programs(running, threads, journal).requests

    def prepare(self, running: Running, threads: int = 1) -> None:
        """Compile, or load, all that steps need."""
        self._programs(running, threads, None).link()

    def _programs(self, running: Running, threads: int, journal: Journal | None) -> "Programs":
        known = running.frames.get(threads)
        if known is None or journal is not None:
            known = Programs(self, running, threads, journal)
            if journal is None:
                running.frames[threads] = known
        return known


class Programs:
    """The programs of a frame: for a thread alone, and for each of several that share the cloth."""

    def __init__(self, solver: Solver, running: Running, size: int, journal: Journal | None) -> None:
        """Make the programs; what they need is compiled when they are linked or first run."""
        vertices, linker = running.assembly.cloth.vertices, Linker()
        self._linker = linker
        self._alone = _frame(solver, Thread(running, 0, 1, journal), Team.alone(vertices), linker)
        self._arrivals = arrivals_for(size)
        self._together: Sequence[Frame] = ()
        if size > 1:
            self._together = [
                _frame(
                    solver,
                    Thread(running, rank, size, journal),
                    Team(rank, size, *span(vertices, rank, size), self._arrivals),
                    linker,
                )
                for rank in range(size)
            ]
        for rank in running.assembly.ranks[:size]:
            if rank.contacts.colliders is not None:
                link_distances(running.assembly.scene, rank.contacts.colliders, rank.contacts.faces, linker)

    @property
    def requests(self) -> list[Request]:
        """The code that is not linked yet."""
        return self._linker.requests

    def link(self) -> None:
        """Find the code of the programs, compiling what is missing."""
        self._linker.link()

    def run(self, substeps: int, duration: float) -> None:
        """Advance by a frame, on one thread where all others are busy."""
        self.link()
        teams.run(
            lambda rank: self._together[rank].run(substeps, duration, teams.require_wanted),
            lambda: self._alone.run(substeps, duration, teams.require_wanted),
            self._arrivals,
        )


def _frame(solver: Solver, thread: Thread, team: Team, linker: Linker) -> Frame:
    order = solver.units(thread, linker)
    return linker.frame(order.begin, order.substep, team)
