"""From lists of units to programs that run: packed groups, and the addresses of compiled code."""

import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from cape.kernels import calling, store
from cape.kernels.jit import COMPILER_OFF
from cape.kernels.packing import GroupKind, Packed
from cape.kernels.program import FrameCall, Program, Use, run_frame
from cape.kernels.team import LINE, Team

BREATH = 0.1  # s that a call of compiled code takes steps, which an interrupt has to wait for
STEP = ("int", "int", "float")  # what a unit is called with after its group and the team: substep, substeps, step [s]


class Linker:
    """Makes programs of units, whose code is found all at once: so that what is missing is compiled side by side.

    Groups that programs share are packed once. The linker must live as long as its programs.
    """

    def __init__(self) -> None:
        """Nothing is linked yet."""
        self._packed: dict[int, Packed] = {}
        self._team = Packed(Team.alone(0)).kind
        self._wanted: list[tuple[store.Request, Callable[[int], None]]] = []

    def program(self, uses: Sequence[Use]) -> Program:
        """Make a program, to be run once `link` has found its code."""
        if COMPILER_OFF:
            program = Program(np.empty(len(uses), object), np.empty(len(uses), object))
            for k, use in enumerate(uses):
                program.units[k], program.groups[k] = use.unit, use.group
            return program
        program = Program(np.zeros(len(uses), np.int64), np.zeros(len(uses), np.int64))
        for k, use in enumerate(uses):
            packed = self._pack(use.group)
            program.groups[k] = packed.address
            self.want(store.Request(use.unit, (packed.kind, self._team, *STEP)), _setter(program.units, k))
        return program

    def want(self, request: store.Request, ready: Callable[[int], None]) -> None:
        """Have `ready` called with the address of some code, when that is found."""
        self._wanted.append((request, ready))

    def frame(self, begin: Sequence[Use], substep: Sequence[Use], team: Team) -> "Frame":
        """Make what advances a cloth by a frame."""
        return Frame(self, self.program(begin), self.program(substep), team)

    @property
    def requests(self) -> list[store.Request]:
        """What `link` will ask for."""
        return [request for request, _ in self._wanted]

    def link(self) -> None:
        """Find the code of all programs made so far, compiling what is not there."""
        store.prepare(self.requests)
        for request, ready in self._wanted:
            ready(store.code_of(request).address)
        self._wanted = []

    def _pack(self, group: Any) -> Packed:
        packed = self._packed.get(id(group))
        if packed is None:
            packed = self._packed[id(group)] = Packed(group, self._packed)
        return packed


def _setter(array: Any, index: int) -> Callable[[int], None]:
    def put(address: int) -> None:
        array[index] = address

    return put


class Frame:
    """A frame's program for one thread; `team` says which."""

    def __init__(self, linker: Linker, begin: Program, substep: Program, team: Team) -> None:
        """Use `Linker.frame`."""
        self._call = FrameCall(begin, substep, team, np.zeros(1, np.int64), np.zeros(1), np.zeros(2, np.int64))
        self._linker, self._entry = linker, None
        self._breath = 1  # steps that are taken in one call
        if not COMPILER_OFF:
            self._packed = linker._pack(self._call)
            assert isinstance(self._packed.kind, GroupKind)
            linker.want(store.Request(run_frame, (self._packed.kind,), spread=True), self._enter)

    def _enter(self, address: int) -> None:
        self._entry = calling.Entry(store.Code(address, "none"))

    def run(self, substeps: int, duration: float, look: Callable[[], None] = lambda: None) -> None:
        """Advance by `duration` [s] in so many steps; other Python threads may go on meanwhile.

        Compiled code hears of no interrupt: it comes back every `BREATH` at the latest, unless a single step takes
        longer, and where it does `look` is called and may raise.
        """
        self._call.substeps[0], self._call.duration[0] = substeps, duration
        done = 0
        while done < substeps:
            look()
            steps = min(self._breath, substeps - done)
            self._call.part[:] = done, done + steps
            begun = time.perf_counter()
            if self._entry is None:
                run_frame.python(*self._call)
            else:
                self._entry(self._packed.address)
            spent = time.perf_counter() - begun
            done += steps
            self._breath = max(1, min(2 * self._breath, int(steps * BREATH / max(spent, 1e-9))))


def arrivals_for(size: int) -> Any:
    """Where the ranks of a team of that size meet."""
    return np.zeros(size * LINE, np.int64)
