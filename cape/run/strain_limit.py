"""Strain from frame to frame: whether any spring is too long, and threads under a limit, if shorter steps would help
or it can't be kept at all."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

import numpy as np
from numpy.typing import NDArray

from cape.assembly.assemble import Assembly
from cape.assembly.fabrics import of_vertices
from cape.assembly.springs import Springs
from cape.kernels.calling import Bound
from cape.kernels.cloth.measure import is_grid_strained, is_strained
from cape.kernels.state import State
from cape.kernels.store import Request

LEFT = 0.01  # strain beyond their limit that is left where shorter steps have not helped for some time
TUG = 12  # frames in a row in which threads are too long, after which it is no tug, but a body that they lie around
IDLE = 12  # frames after which a limit that could not be kept is tried again
TORN = 0.1  # strain beyond their limit at which a few threads bear what others are not let to


def strain_check(springs: Springs, state: State, most: float) -> Bound:
    """What tells whether any spring at a state, which may change in place, is strained by more than `most`."""
    families = springs.families
    if families is None or springs.in_slots:
        links = (np.ascontiguousarray(each) for each in (springs.first, springs.second, springs.rest))
        return Bound(is_strained, *state[:3], *links, most)
    # Loads of neighbours that lie side by side take far less time than those by indices.
    squared = np.where(families.stiffness > 0.0, ((1.0 + most) * families.rest) ** 2, np.inf)
    return Bound(is_grid_strained, *state[:3], families.offsets, squared.astype(state.x.dtype))


class StrainLimit:
    """The threads of a cloth at a state, which may change in place; those that are held at both ends don't count.

    Attributes:
        lasting: for how many frames in a row threads have been too long that no two limbs pinch.
    """

    def __init__(self, assembly: Assembly, state: State, longest: Sequence[NDArray[np.floating]]) -> None:
        """Choose the threads of a scene that limits strain; of others none.

        `longest`, arrays of any shape, is what steps let them be [m]; none where nothing limits them.
        """
        springs, free = assembly.springs, assembly.free
        self._chosen = chosen = springs.measured & (free[springs.first] | free[springs.second])
        self._first, self._second, self._rest = springs.first[chosen], springs.second[chosen], springs.rest[chosen]
        self._most = of_vertices(assembly.cloth, lambda f: max(f.limit_warp, f.limit_weft), self._first)
        self._state, self._colliders = state, assembly.contacts.colliders
        self._longest, self._usual = longest, [each.copy() for each in longest]
        self._idle, self.lasting = 0, 0
        # Where threads have limits of their own, lengths that they may get are told in place of those at rest.
        alike = self._most.ndim == 0
        rest, most = (self._rest, float(self._most)) if alike else ((1.0 + self._most) * self._rest, 0.0)
        self._any = Bound(is_strained, *state[:3], self._first, self._second, rest, most)

    @property
    def requests(self) -> list[Request]:
        """The code that it needs, to be compiled together with other code."""
        return [self._any.request] if self._longest else []

    @property
    def acts(self) -> bool:
        """Whether steps hold threads short; where they may and don't, threads are left to their stiffness."""
        return len(self._longest) > 0 and self._idle == 0

    @acts.setter
    def acts(self, acts: bool) -> None:
        self.idle = 0 if acts else max(self._idle, 1)

    @property
    def idle(self) -> int:
        """For how many frames threads have been left to their stiffness, 0 where steps hold them short."""
        return self._idle

    @idle.setter
    def idle(self, idle: int) -> None:
        if (idle == 0) != (self._idle == 0):
            for now, usual in zip(self._longest, self._usual, strict=True):
                now[:] = usual if idle == 0 else np.inf
        self._idle = idle

    @contextmanager
    def refitted(self, springs: Springs) -> Iterator[None]:
        """Let what threads may get to be changed within, and know which vertices these lead to then."""
        idle, self.idle = self._idle, 0
        yield
        for now, usual in zip(self._longest, self._usual, strict=True):
            usual[:] = now
        self._first[:], self._second[:] = springs.first[self._chosen], springs.second[self._chosen]
        self.idle = idle

    def is_too_much(self, excess: float) -> bool:
        """Tell whether an `excess` is one for which shorter steps are worth while.

        Where threads have been too long for some time, a little is left: else steps would be shorter in every frame.
        """
        return excess > (LEFT if self.lasting >= TUG else 0.0)

    def excess(self) -> float:
        """By how much more than they may threads are strained that shorter steps may shorten, 0 at least.

        Those are the ones that no two limbs pinch.
        """
        if not self.acts or not self._any():
            return 0.0
        beyond = self._strains() - self._most
        if self._colliders is not None:
            pinched = self._colliders.pinched
            beyond = beyond[~pinched[self._first] & ~pinched[self._second]]
        return float(beyond.max(initial=0.0))

    def long(self) -> NDArray[np.bool_]:
        """Which vertices are at an end of a thread that is strained too much, shape (N,)."""
        found = np.zeros(len(self._state.x), bool)
        if self._longest and self._any():
            chosen = self._strains() > self._most
            found[self._first[chosen]] = found[self._second[chosen]] = True
        return found

    def torn(self) -> bool:
        """Tell whether some bear far more than the limit, as where limbs draw out more than all together may give."""
        return self.acts and bool(self._any()) and bool((self._strains() > self._most + TORN).any())

    def rest(self, touches: Callable[[NDArray[np.float64]], bool]) -> None:
        """Limit threads again at the end of a frame, once their stiffness alone has brought them back to what they may
        bear; or after some frames, as in few steps that may never do so, if no limb draws them out any more.

        `touches` tells whether any of some points [m], shape (n, 3), touches a collider.
        """
        if self._idle:
            again = not self._any() or (self._idle % IDLE == 0 and not touches(self._torn_ones()))
            self.idle = 0 if again else self._idle + 1

    def _torn_ones(self) -> NDArray[np.float64]:
        """The ends and middles of threads that bear far more than the limit [m], shape (n, 3)."""
        places, chosen = np.stack(self._state[:3], axis=1).astype(float), self._strains() > self._most + TORN
        first, second = places[self._first[chosen]], places[self._second[chosen]]
        return np.concatenate([first, 0.5 * (first + second), second])

    def _strains(self) -> NDArray[np.float64]:
        places = np.stack(self._state[:3], axis=1).astype(float)
        return np.linalg.norm(places[self._second] - places[self._first], axis=1) / self._rest - 1.0
