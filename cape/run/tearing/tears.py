"""How a running cloth tears, from frame to frame.

It is seen where the cloth parts at the end of each frame, and of each part of a long one. A tear goes on by at most a
few edges at each of its tips then, and what is left bears the load by its springs and its inertia until the next time.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cape.cloth.split_grid import SplitGrid
from cape.kernels.state import State
from cape.kernels.store import Request
from cape.run.hanging import Hanging
from cape.run.tearing import tethers
from cape.run.tearing.cracks import parting
from cape.run.tearing.layers import SplitLayers
from cape.run.tearing.loads import Loads, Scale
from cape.run.tearing.refit import look_at_layers, refit
from cape.run.tearing.refit_mesh import following, refit_mesh
from cape.run.tearing.sheet import Edge, Sheet
from cape.run.tearing.sheets import sheet_of, triangles_of
from motions.errors import ValueRangeError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

PARTS = 2  # of a long frame in which the cloth may part; shorter ones would take more time for what is parted
LONG = 500_000  # vertices times steps, some 10 ms
WARY = 0.7  # of what it may bear, from which on it may do so in the next frame


class Tears:
    """The tears of one cloth that hangs.

    Attributes:
        sheet: how its cells share corners.
        released: energy that was stored in what bent across edges that have parted [J].
    """

    def __init__(self, cloth: Hanging) -> None:
        """Begin with a cloth that is whole."""
        scene = cloth.assembly.scene
        assert scene.tearing is not None
        self._cloth = scene.cloth
        fixed = np.zeros(self._cloth.vertices, bool)
        for vertices in cloth.held:
            fixed[vertices] = True
        self._held, self.sheet = fixed, sheet_of(self._cloth, fixed)
        self.released = 0.0
        self._scale = Scale(self._cloth, scene.tearing)
        self._wary, self._layers_known = False, True
        self._shown: State | None = None  # where the vertices are, as the sheet numbers them
        self._layers = SplitLayers(cloth.assembly.layers, cloth.assembly.cloth)
        self._following = following(cloth)

    def keep(self, vertex: int, *, whole: bool) -> None:
        """Have a vertex never split while a hand holds it, or let it."""
        fixed = self.sheet.fixed.copy()
        fixed[vertex] = whole or (vertex < len(self._held) and self._held[vertex])
        self.sheet = replace(self.sheet, fixed=fixed)

    def become(self, cloth: Hanging, sheet: Sheet) -> None:
        """Have a cloth that is whole, or has torn less, be torn as another one is of the same cells, wherever it is.

        What bones and hands hold of this one is its own: that splits no further, whatever held the other.
        """
        before, count = self.sheet, self.sheet.vertices
        copies = np.zeros(sheet.vertices, np.int64)
        copies[sheet.cells] = before.cells
        fixed = np.concatenate([before.fixed, np.zeros(sheet.vertices - count, bool)])
        self._go_on(cloth, replace(sheet, fixed=fixed), copies[count:])
        self.end_frame(cloth)

    def parts(self, cloth: Hanging, substeps: int) -> int:
        """In how many parts the next frame of so many substeps is to be taken."""
        return PARTS if self._wary and cloth.state.x.size * substeps >= LONG else 1

    @property
    def triangles(self) -> NDArray[np.int32]:
        """Vertices of the triangles as they are now, shape (T, 3)."""
        return triangles_of(self._cloth, self.sheet)

    def look(self, cloth: Hanging) -> None:
        """Let the cloth part where it bears too much."""
        loads = self._weigh(cloth)
        self._wary = loads.worst > WARY
        if loads.worst <= 1.0:
            return
        self._go_on(cloth, *parting(self.sheet, loads))

    def _weigh(self, cloth: Hanging) -> Loads:
        """What the vertices bear as the sheet numbers them."""
        assembly, state = cloth.assembly, cloth.state
        if assembly.order is None:
            return self._scale.loads(self.sheet, state)
        shown = [assembly.outwards(component) for component in state[:3]]
        if self._shown is None or self._shown.x.shape != shown[0].shape:
            self._shown = State(*(np.zeros_like(shown[0]) for _ in state))
        for own, component in zip(self._shown[:3], shown, strict=True):
            own[:] = component
        return self._scale.loads(self.sheet, self._shown)

    def requests(self, cloth: Hanging) -> list[Request]:
        """The code that a run needs besides that of the cloth."""
        own = self._scale.requests(self.sheet, cloth.state)
        found = tethers.requests(cloth.assembly) + self._layers.requests
        return [*own, *found, *self._following, *cloth.follow_requests]

    def part(self, cloth: Hanging, vertices: ArrayLike) -> int:
        """Part the edges from each of some vertices to the next, shape (n,); gives how many have parted.

        Raises:
            ValueRangeError: a vertex is none, or two are no neighbours.
        """
        before = self.sheet.tears
        self._go_on(cloth, *self.sheet.split(edges_along(self.sheet, vertices)))
        self.end_frame(cloth)
        return self.sheet.tears - before

    def end_frame(self, cloth: Hanging) -> None:
        """Have contact of the cloth with itself know of edges that have parted."""
        if not self._layers_known:
            look_at_layers(cloth, self._layers)
        self._layers_known = True

    def _go_on(self, cloth: Hanging, sheet: Sheet, copies: IntArray) -> None:
        """Go on with another sheet, whose last vertices are copies of the given ones."""
        if not len(copies):
            return
        known, of_grid = cloth.assembly.layers, isinstance(cloth.assembly.cloth, SplitGrid)
        self.released += (refit if of_grid else refit_mesh)(cloth, sheet, copies)
        self.sheet = sheet
        # A mesh that was laid out anew was so as it has split.
        self._layers_known = known is None or not (of_grid or cloth.assembly.layers is known)


def edges_along(sheet: Sheet, vertices: ArrayLike) -> list[Edge]:
    """The edges from each of some vertices to the next, shape (n,).

    Raises:
        ValueRangeError: a vertex is none, or two are no neighbours.
    """
    path = np.asarray(vertices)
    if path.ndim != 1 or len(path) < 2 or path.dtype.kind not in "iu":
        raise ValueRangeError("a tear leads along the edges between at least two vertices, given by whole numbers")
    if (outside := (path < 0) | (path >= sheet.vertices)).any():
        raise ValueRangeError(f"vertex {path[outside][0]} is outside of a cloth of {sheet.vertices} vertices")
    for first, second in zip(path[:-1].tolist(), path[1:].tolist(), strict=True):
        near = sheet.edges_at(first)
        if second not in near:
            there = ", ".join(map(str, sorted(near)))
            raise ValueRangeError(f"no edge leads from vertex {first} to {second}; from there they lead to {there}")
    return [(min(a, b), max(a, b)) for a, b in zip(path[:-1].tolist(), path[1:].tolist(), strict=True)]
