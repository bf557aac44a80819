"""What the vertices of a cloth bear: strain of threads, tension per width, and the direction of the largest.

The tension per width of each cell comes from its strains and the stiffness of its fabric. The mean over the cells
around a vertex, by what they bear, tells whether the cloth parts there, and across which direction: that of the largest
principal tension, as O'Brien and Hodgins 1999, "Graphical modeling and animation of brittle fracture", section 3.2,
take it for solids, and Pfaff, Narain, de Joya and O'Brien 2014, "Adaptive tearing and cracking of thin sheets", section
4, for sheets.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assembly.fabrics import fabrics_of, patchwork_of
from cape.assembly.membrane import plane_stiffness
from cape.cloth.cloth import Cloth, GridCloth
from cape.kernels.calling import Bound
from cape.kernels.state import State
from cape.kernels.store import Request
from cape.kernels.tearing.loads import SUMS, Borne, Gauged, GaugedMesh, bear, gauge_grid, gauge_mesh
from cape.run.tearing.sheet import Sheet
from cape.scene.tearing import Tearing

FloatArray = NDArray[np.float64]


class Loads(NamedTuple):
    """At each of V vertices: how many times what it may bear it does, and a unit vector along weft and warp (V, 2) in
    which it is drawn most, where that is more than it may bear. The `worst` is the largest of all ratios."""

    ratio: FloatArray
    along: FloatArray
    worst: float


class Scale:
    """Weighs what a cloth bears; its arrays are made anew where a state or a sheet is another."""

    def __init__(self, cloth: Cloth, tearing: Tearing) -> None:
        """Measure the cloth at rest."""
        self._stiffness = np.stack([plane_stiffness(fabric) for fabric in fabrics_of(cloth)])
        patches = patchwork_of(cloth)
        self._fabric, self._tearing = None if patches is None else patches.number, tearing
        self._is_grid = isinstance(cloth, GridCloth)
        if isinstance(cloth, GridCloth):
            places = cloth.places_at_rest[cloth.cells]
            if places.shape[2] == 2:
                places = np.concatenate([places, np.zeros((*places.shape[:2], 1))], axis=2)
            self._rest = lengths_and_angle(*middle_lines(places))
        else:
            sides = cloth.corners_at_rest[:, 1:] - cloth.corners_at_rest[:, :1]
            self._slopes = np.ascontiguousarray(np.linalg.inv(np.swapaxes(sides, 1, 2)), dtype=float)
        self._known: tuple[State, Bound, Bound, Borne] | None = None

    def requests(self, sheet: Sheet, state: State) -> list[Request]:
        """The code that weighing needs, to be compiled together with other code."""
        _, gauge, weigh, _ = self._for(sheet, state)
        return [gauge.request, weigh.request]

    def loads(self, sheet: Sheet, state: State) -> Loads:
        """What the vertices of a sheet bear, numbered as in a state whose first vertices are those."""
        _, gauge, weigh, borne = self._for(sheet, state)
        borne.cells[:] = sheet.cells.T
        gauge()
        worst = float(weigh())
        return Loads(borne.ratio[: sheet.vertices], borne.along[:, : sheet.vertices].T, worst)

    def _for(self, sheet: Sheet, state: State) -> tuple[State, Bound, Bound, Borne]:
        known = self._known
        if known is None or known[0].x is not state.x:
            count, cells = state.x.size, len(sheet.cells)
            force, strain = (np.inf if most is None else most for most in (self._tearing.force, self._tearing.strain))
            borne = Borne(
                np.ascontiguousarray(sheet.cells.T), np.zeros((3, cells)), sheet.area, self._stiffness, self._fabric,
                force, strain, np.zeros((SUMS, count)), np.zeros(count), np.zeros((2, count)),
            )  # fmt: skip
            if self._is_grid:
                gauge = Bound(gauge_grid, Gauged(state, borne.cells, *self._rest, borne.strains))
            else:
                gauge = Bound(gauge_mesh, GaugedMesh(state, borne.cells, self._slopes, borne.strains))
            known = self._known = state, gauge, Bound(bear, borne), borne
        return known


def middle_lines(corners: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lines across and down through the middle of cells with corners (P, 4, 3) [m], each of shape (P, 3)."""
    first, second, third, fourth = (corners[:, k] for k in range(4))
    return (second + third - first - fourth) / 2.0, (third + fourth - first - second) / 2.0


def lengths_and_angle(right: FloatArray, down: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Lengths of vectors (P, 3) [m], each of shape (P,), and the cosine of the angle between them (P,)."""
    across, along = (np.sqrt(np.einsum("pd,pd->p", line, line)) for line in (right, down))
    return across, along, np.einsum("pd,pd->p", right, down) / np.maximum(across * along, 1e-30)
