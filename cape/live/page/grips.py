"""What is dragged on the page, as orders: who holds which vertex of the cloth, and who leads which object.

Nothing here knows the library that serves the page. What it tells of a drag has to come in the order in which it
happened, and several who look at the page may drag at the same time; frames come from another thread.
"""

from collections import deque
from collections.abc import Callable, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]

STILL = 1e-3  # [m] that the world goes by until what is held is led along
REMEMBERED = 30  # frames that were shown last: a browser that draws slowly shows the cloth where it was

Say = Callable[..., Any]


class Drag(Protocol):
    """How a drag goes, as viser tells it: places are in the coordinates of the page [m].

    `end_position` is where the pointer is in the plane of the picture through what was grabbed; at the start, the point
    that was grabbed, where it was when the button went down.
    """

    @property
    def client_id(self) -> int:
        """Who drags."""
        ...

    @property
    def phase(self) -> str:
        """`start`, `update` or `end`."""
        ...

    @property
    def end_position(self) -> Sequence[float]:
        """Where the pointer is."""
        ...


class Grips:
    """Turns drags into orders.

    Attributes:
        offset: from places in the world to those on the page [m], shape (3,).
    """

    def __init__(self, say: Say) -> None:
        """Hold nothing; `say` takes the name of an order, and what belongs to it."""
        self._say = say
        self.offset = np.zeros(3)
        self._shown: deque[NDArray[np.float32]] = deque(maxlen=REMEMBERED)
        self._held: dict[int, tuple[int, FloatArray]] = {}  # which vertex, and where on the page, by who drags
        self._led: dict[tuple[int, str], FloatArray] = {}

    def show(self, positions: NDArray[np.float32], offset: ArrayLike = (0.0, 0.0, 0.0)) -> None:
        """Take where the page shows the vertices [m], shape (V, 3), and by how much that is off the world.

        What is held stays where it is on the page, also where the world goes by under it.
        """
        before, self.offset = self.offset, np.array(offset, dtype=float)
        self._shown.append(positions)
        if np.linalg.norm(self.offset - before) > STILL:
            for vertex, there in [*self._held.values()]:
                self._reach(vertex, there)

    def cloth(self, drag: Drag) -> None:
        """Take hold of the vertex that is dragged, lead it, or let it go."""
        there = np.asarray(drag.end_position, dtype=float)
        if not np.isfinite(there).all():
            return
        if drag.phase == "start":
            self._let_go(drag.client_id)
            if (vertex := self._vertex_at(there)) is None:
                return
            self._say("grab", vertex)
        elif drag.client_id in self._held:
            vertex, _ = self._held[drag.client_id]
        else:
            return
        if drag.phase == "end":
            self._let_go(drag.client_id)
        else:
            self._held[drag.client_id] = vertex, there
            self._reach(vertex, there)

    def object(self, bone: str, drag: Drag) -> None:
        """Lead an object by as much as the pointer has gone."""
        there, key = np.asarray(drag.end_position, dtype=float), (drag.client_id, bone)
        if not np.isfinite(there).all():
            return
        before = self._led.pop(key, None)
        if drag.phase != "start" and before is not None:
            self._say("move", bone, *(float(part) for part in there - before))
        if drag.phase != "end":
            self._led[key] = there

    def _let_go(self, who: int) -> None:
        if (held := self._held.pop(who, None)) is not None:
            self._say("let_go", held[0])

    def _reach(self, vertex: int, there: FloatArray) -> None:
        self._say("reach", vertex, *(float(part) for part in there - self.offset))

    def _vertex_at(self, there: FloatArray) -> int | None:
        """The vertex at a place on the page, in whichever of the last frames one comes nearest to it."""
        nearest, found = np.inf, None
        for positions in reversed(tuple(self._shown)):
            off = np.linalg.norm(positions - there, axis=1)
            if off.min() < nearest:
                nearest, found = float(off.min()), int(off.argmin())
        return found
