"""What the vertices of a cloth bear that may tear; see `cape.run.tearing.loads`."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.jit import inlined, routine
from cape.kernels.state import State

FloatArray = NDArray[np.float64]
TINY = 1e-12  # N/m that every cell counts for, so that sums are never nothing
SUMS = 6  # by vertex: of tension along weft, warp and in shear, strains along weft and warp, all by weight; of weights


class Borne(NamedTuple):
    """Cells (k, P) of a cloth, their `strains` along weft, warp and of the angle (3, P), and `area` [m2] (P,).

    `stiffness` (F, 3, 3) [N/m] of each of F fabrics, and of which of them each cell is, `fabric` (P,), None where there
    is one; `force` [N/m] and `strain` at which threads part, infinite for never. Room: `sums`
    (SUMS, V). What comes out: `ratio` (V,) of what each vertex bears to what it may, and `along` (2, V), in which
    direction of weft and warp it is drawn most, where that is more than it may bear.
    """

    cells: NDArray[np.int64]
    strains: FloatArray
    area: FloatArray
    stiffness: FloatArray
    fabric: NDArray[np.int64] | None
    force: float
    strain: float
    sums: FloatArray
    ratio: FloatArray
    along: FloatArray


class Gauged(NamedTuple):
    """A grid at a state, with cells (4, P), the lengths of the lines through the middle of each at rest, `right` and
    `down` [m], and the `cosine` of their angle (P,); `strains` (3, P) are set."""

    state: State
    cells: NDArray[np.int64]
    right: FloatArray
    down: FloatArray
    cosine: FloatArray
    strains: FloatArray


@routine
def gauge_grid(g):
    """Measure how the cells of a grid are strained along weft and warp, and how the angle between these is."""
    x, y, z, cells, strains = g.state.x, g.state.y, g.state.z, g.cells, g.strains
    for p in range(g.right.size):
        a, b, c, d = cells[0, p], cells[1, p], cells[2, p], cells[3, p]
        rx, dx = middle_lines(float(x[a]), float(x[b]), float(x[c]), float(x[d]))
        ry, dy = middle_lines(float(y[a]), float(y[b]), float(y[c]), float(y[d]))
        rz, dz = middle_lines(float(z[a]), float(z[b]), float(z[c]), float(z[d]))
        across, along = math.sqrt(rx * rx + ry * ry + rz * rz), math.sqrt(dx * dx + dy * dy + dz * dz)
        strains[0, p] = across / g.right[p] - 1.0
        strains[1, p] = along / g.down[p] - 1.0
        strains[2, p] = (rx * dx + ry * dy + rz * dz) / max(across * along, 1e-30) - g.cosine[p]


class GaugedMesh(NamedTuple):
    """A mesh at a state, with triangles `cells` (3, T) and the `slopes` (T, 2, 2) [1/m] by which their sides tell how
    weft and warp lead; `strains` (3, T) are set."""

    state: State
    cells: NDArray[np.int64]
    slopes: FloatArray
    strains: FloatArray


@routine
def gauge_mesh(g):
    """Measure how triangles are strained along weft and warp, and the cosine of the angle between these."""
    for t in range(g.slopes.shape[0]):
        ux, vx = gradient(g.state.x, g.cells, g.slopes, t)
        uy, vy = gradient(g.state.y, g.cells, g.slopes, t)
        uz, vz = gradient(g.state.z, g.cells, g.slopes, t)
        weft, warp = math.sqrt(ux * ux + uy * uy + uz * uz), math.sqrt(vx * vx + vy * vy + vz * vz)
        g.strains[0, t], g.strains[1, t] = weft - 1.0, warp - 1.0
        g.strains[2, t] = (ux * vx + uy * vy + uz * vz) / max(weft * warp, 1e-30)


@inlined
def gradient(x, cells, slopes, t):
    """How a coordinate of triangle t grows along weft and warp."""
    a, b, c = float(x[cells[0, t]]), float(x[cells[1, t]]), float(x[cells[2, t]])
    return slopes[t, 0, 0] * (b - a) + slopes[t, 1, 0] * (c - a), slopes[t, 0, 1] * (b - a) + slopes[t, 1, 1] * (c - a)


@inlined
def middle_lines(a, b, c, d):
    """Along one coordinate, the lines across and down through the middle of a cell with corners a, b, c and d."""
    return 0.5 * (b + c - a - d), 0.5 * (c + d - a - b)


@inlined
def number_of(fabric, p):
    """Number of the fabric that cell p is of."""
    if fabric is None:
        return 0
    return fabric[p]


@routine
def bear(g):
    """Set what each vertex bears, and where that is too much its direction; gives the largest ratio of all."""
    cells, sums, fabric, corners = g.cells, g.sums, g.fabric, g.cells.shape[0]
    for k in range(SUMS):
        for i in range(g.ratio.size):
            sums[k, i] = 0.0
    for p in range(g.area.size):
        u, v, w = g.strains[0, p], g.strains[1, p], g.strains[2, p]
        c = g.stiffness[number_of(fabric, p)]
        tu, tv = c[0, 0] * u + c[0, 1] * v, c[0, 1] * u + c[1, 1] * v
        tw = c[2, 2] * w
        largest = 0.5 * (tu + tv) + math.sqrt(0.25 * (tu - tv) ** 2 + tw * tw)
        weight = g.area[p] * (max(largest, 0.0) + TINY)
        for k in range(corners):
            i = cells[k, p]
            sums[0, i] += weight * tu
            sums[1, i] += weight * tv
            sums[2, i] += weight * tw
            sums[3, i] += weight * u
            sums[4, i] += weight * v
            sums[5, i] += weight
    worst = 0.0
    for i in range(g.ratio.size):
        ratio = 0.0
        if sums[5, i] > 0.0:
            share = 1.0 / sums[5, i]
            tu, tv, tw = share * sums[0, i], share * sums[1, i], share * sums[2, i]
            ratio = (0.5 * (tu + tv) + math.sqrt(0.25 * (tu - tv) ** 2 + tw * tw)) / g.force
            u, v = share * sums[3, i] / g.strain, share * sums[4, i] / g.strain
            drawn = max(u, v)
            if max(ratio, drawn) > 1.0:
                angle = 0.5 * math.atan2(tw, 0.5 * (tu - tv))
                du, dv = math.cos(angle), math.sin(angle)
                if drawn > ratio:
                    du, dv = 1.0 if u >= v else 0.0, 0.0 if u >= v else 1.0
                g.along[0, i], g.along[1, i] = du, dv
            ratio = max(ratio, drawn)
        g.ratio[i] = ratio
        worst = max(worst, ratio)
    return worst
