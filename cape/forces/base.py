"""What every force is."""

from abc import ABC, abstractmethod
from typing import Any, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assembly.assemble import Assembly
from cape.kernels.cloth.grid import GridRoom
from cape.kernels.cloth.stream import Against, against_stream
from cape.kernels.program import Use
from cape.kernels.state import State
from cape.scene.scene import Scene


class Acting(NamedTuple):
    """What forces act on: a cloth at a state of N vertices, and `forces` (3, N) [N] that they set or add to.

    `room` is the scratch of a thread, None for a mesh. All are in the precision of the state.
    """

    assembly: Assembly
    state: State
    forces: NDArray[np.floating]
    room: GridRoom | None

    def against(self, relative: NDArray[np.floating] | None) -> tuple["Acting", list[Use]]:
        """The same with velocities (3, N) against the air of the stream, and the unit that sets them.

        Itself, and no unit, where None is given for `relative`, which threads share.
        """
        if relative is None:
            return self, []
        stream = self.assembly.stream
        assert stream is not None
        seen = State(*self.state[:3], *relative)
        return self._replace(state=seen), [Use(against_stream, Against(self.state, stream, relative))]

    @property
    def dtype(self) -> type[np.floating]:
        """The precision."""
        return self.state.x.dtype.type


class Force(ABC):
    """A force: which scenes have it, the units that compute it, its energy, and where that is accounted for.

    Attributes:
        name: what to call it.
        account: the entry of the ledger that its work belongs to; what an elastic force, or one that holds the cloth,
            does more at a velocity than at rest is damping.
        sets: whether its units set the forces rather than add to them; such a one comes first, and alone.
    """

    name: ClassVar[str]
    account: ClassVar[Literal["elastic", "air", "hold"]]
    sets: ClassVar[bool] = False

    @staticmethod
    @abstractmethod
    def acts(scene: Scene) -> bool:
        """Tell whether a scene has the force."""

    @classmethod
    def is_in(cls, assembly: Assembly) -> bool:
        """Tell whether an assembled cloth has the force: where its scene does, for most."""
        return cls.acts(assembly.scene)

    @staticmethod
    @abstractmethod
    def arrays(assembly: Assembly, dtype: type[np.floating]) -> Any:
        """The arrays of the force in a precision, which all threads of a run share."""

    @staticmethod
    @abstractmethod
    def uses(acting: Acting, arrays: Any) -> list[Use]:
        """The units that compute the force for one thread, with what they work on."""

    @staticmethod
    def energy(assembly: Assembly, positions: NDArray[np.float64]) -> float:
        """Potential energy [J] of the vertices at positions [m], shape (N, 3), as the assembly numbers them."""
        return 0.0
