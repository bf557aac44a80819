"""A solver at work on a cloth: its arrays, and the programs of a frame for each thread."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assembly.assemble import Assembly
from cape.assembly.contact import Contacts
from cape.assembly.grid.limits import longest_threads, stray_links
from cape.assembly.mesh.limits import limited_links
from cape.kernels.bones import Motion, MotionRoom
from cape.kernels.contact.drawn import Drawn
from cape.kernels.solve.journal import Journal
from cape.kernels.state import State


class Running:
    """What a solver has made for one cloth, and where the bones move in the frame at hand.

    Attributes:
        assembly: the scene's arrays.
        state: of the vertices, which steps change in place.
        corrected: what contact and limits of strain act on: the state, or a copy in single precision that solvers
            may have them act on in its place (see `kernels.solve.rounding`).
        earlier: room for where vertices were at a step's start [m], (3, N), in the precision of such a copy; else None.
        inverse_mass: [1/kg] of the vertices in the precision of what is corrected, zero for attached ones, shape (N,).
        arrays: the solver's own.
        longest: that threads of a grid may get [m], shape (2, N); None where nothing limits their strain.
        strays: those of a grid that lead to what has split off; None where none can, or nothing limits strain.
        links: those of a mesh that may get no longer than they are told to; None where nothing limits strain.
        drawn: what a limit of strain does to vertices that contact stops.
        motion: of the bones in a frame, filled anew for each.
        duration: of that frame [s], shape (1,).
        frames: programs that were made, by number of threads.
    """

    def __init__(self, assembly: Assembly, state: State, arrays: Any, *, rounded: bool = False) -> None:
        """Hold the arrays; programs are made with the first step.

        Where the state is to be `rounded`, a copy in single precision is corrected.
        """
        self.assembly, self.state, self.arrays = assembly, state, arrays
        self.corrected, self.inverse_mass, self.earlier = state, arrays.inertia.inverse_mass, None
        if rounded and state.x.dtype != np.float32:
            self.corrected = State(*(component.astype(np.float32) for component in state))
            self.inverse_mass = self.inverse_mass.astype(np.float32)
            self.earlier = np.zeros((3, len(state.x)), np.float32)
        dtype = self.corrected.x.dtype.type
        self.longest = longest_threads(assembly, dtype)
        self.strays = stray_links(assembly, dtype)
        self.links = limited_links(assembly, dtype)
        limited = (self.longest is not None or self.links is not None) and bool(assembly.scene.colliders)
        self.drawn = Drawn.blank(assembly.cloth.vertices if limited else 1, acts=limited)
        bones = len(assembly.scene.bones) + 1
        self.motion = Motion(*(np.zeros((bones, size)) for size in (3, 4, 3, 4)))
        self.duration = np.zeros(1)
        self.frames: dict[int, Any] = {}

    @property
    def limits(self) -> tuple[NDArray[np.floating], ...]:
        """How long threads may get [m], of a grid shape (2, N) and (n,), of a mesh (n,); none where nothing limits
        them."""
        strays = None if self.strays is None else self.strays.links
        lists = (each.longest for each in (strays, self.links) if each is not None)
        return (*lists,) if self.longest is None else (self.longest, *lists)

    def go_on_with(self, assembly: Assembly) -> None:
        """Take the same assembly with other notes, as `Assembly.with_layers` gives it, for the steps to come."""
        self.assembly = assembly
        self.frames.clear()


class Thread(NamedTuple):
    """One of `size` threads that share a cloth; `journal` is what its steps are noted in, None for nowhere."""

    running: Running
    rank: int
    size: int
    journal: Journal | None

    @property
    def contacts(self) -> Contacts:
        """What the cloth can't enter, with this thread's own notes."""
        return self.running.assembly.ranks[self.rank].contacts

    @property
    def bones(self) -> MotionRoom:
        """Where the bones are, as this thread moves them."""
        return self.running.assembly.ranks[self.rank].room

    @property
    def is_first(self) -> bool:
        """Tell whether this is the thread that does what only one may do."""
        return self.rank == 0
