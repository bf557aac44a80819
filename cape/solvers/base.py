"""What every solver is."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np

from cape.assembly.assemble import Assembly
from cape.kernels.records import Motion, State, Team
from cape.kernels.solve.journal import Journal
from cape.solvers.threads import run
from motions.errors import ValueRangeError

Precision = Literal["single", "double"]


@dataclass(frozen=True, kw_only=True)
class Solver(ABC):
    """How a cloth is advanced by one frame; holds settings alone, never the state of a run.

    Attributes:
        substeps: steps in each frame, None to let the solver choose.
        precision: of the cloth's positions and velocities; None to let the solver choose.
        usual_precision: what it chooses, unless a scene needs another.
        order: power of the step by which errors of moving cloth shrink, as measured on the scene `swing`.
        sweeps: whether springs act by impulses that are found in sweeps over them, rather than by their forces.
    """

    name: ClassVar[str]
    usual_precision: ClassVar[Precision]
    order: ClassVar[float]
    sweeps: ClassVar[bool] = False
    substeps: int | None = None
    precision: Precision | None = None

    def __post_init__(self) -> None:
        """Check the settings.

        Raises:
            ValueRangeError: the number of substeps is not positive, or the precision is unknown.
        """
        if self.substeps is not None and self.substeps < 1:
            raise ValueRangeError(f"substeps must be 1 or more, not {self.substeps}")
        if self.precision not in ("single", "double", None):
            raise ValueRangeError(f"precision must be single or double, not {self.precision!r}")

    def dtype(self, assembly: Assembly) -> type[np.floating]:
        """The precision for a scene, as a numpy type: as asked, or the usual one."""
        return np.float32 if (self.precision or self.usual_precision) == "single" else np.float64

    @abstractmethod
    def init(self, assembly: Assembly) -> Any:
        """Prepare the arrays that the steps of one run share."""

    @abstractmethod
    def choose_substeps(self, room: Any, duration: float, *, strained: bool = False) -> int:
        """Number of steps in a frame of `duration` [s], also of a cloth that is strained far."""

    @property
    @abstractmethod
    def _frame(self) -> Callable[..., Any]:
        """The compiled function that advances a frame; after `_arguments` substeps, duration [s], journal and team."""

    @abstractmethod
    def _arguments(self, assembly: Assembly, room: Any, rank: int, state: State, motion: Motion) -> tuple[Any, ...]:
        """What the thread of that rank passes to `_frame` first."""

    def step(
        self,
        assembly: Assembly,
        room: Any,
        state: State,
        motion: Motion,
        *,
        duration: float,
        substeps: int,
        threads: int = 1,
        journal: Journal | None = None,
    ) -> int:
        """Advance `state` in place by a frame of `duration` [s], while the bones move as `motion` tells.

        `threads` is at most the number of the assembly's ranks; it never changes the result. Nor does a `journal`, with
        room for all substeps, which is filled with what each of them did.

        Returns:
            How many solves within the frame did not reach the solver's tolerance, 0 for explicit methods.
        """

        def arguments(member: Team | None) -> tuple[Any, ...]:
            rank = 0 if member is None else member.rank
            return (*self._arguments(assembly, room, rank, state, motion), substeps, duration, journal, member)

        run(self._frame, arguments, threads)
        return 0
