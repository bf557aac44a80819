"""The bends of a mesh, derived anew where edges have parted; see `cape.assembly.mesh.curvature`."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.cloth.slopes import Flat, Patch, fit_slopes, gather, number_sides, weigh_sides
from cape.kernels.jit import routine
from cape.kernels.tearing.mesh_springs import BENT, ROWS, Bends, Found, collect

FloatArray = NDArray[np.float64]
Indices = NDArray[np.int64]

NOTHING = 1e-9  # size of a curvature's coefficients, times the area, below which they are rounding
WIDER_SLOPES, WIDER_ROWS = -1, -2  # what there is no room for


class BendRoom(NamedTuple):
    """Room to derive the bends of up to B triangles of T anew, as the routines of `kernels.cloth.slopes` ask for it;
    `number` (3 T,) and `place` (N,) are -1."""

    number: Indices
    sides: Indices
    of: Indices
    slopes: FloatArray
    vertices: Indices
    across: FloatArray
    ends: FloatArray
    faces: Indices
    place: Indices
    members: Indices
    rows: FloatArray


class BentParts(NamedTuple):
    """A mesh that lies flat, areas of its triangles times the layers [m2] (T,) and their bending stiffness [N m]
    (T, 3), its bends, what has changed, and room."""

    flat: Flat
    patch: Patch
    half: int
    area: FloatArray
    plate: FloatArray
    bends: Bends
    found: Found
    room: BendRoom


@routine
def bend_anew(g):
    """Derive the bends of triangles anew that bend otherwise by now, and list the vertices that any led to or do.

    Gives how many vertices the widest has; or what there was no room for, with nothing changed.
    """
    room, bends, count = g.room, g.bends, g.found.counts[BENT]
    bent, of, faces = g.found.bent[:count], room.of[:count], room.faces[:count]
    edges = number_sides(g.flat, bent, room.number, room.sides, of)
    g.patch.taken[:] = -1
    g.patch.met[:] = -1
    vertices, slopes = room.vertices[:edges], room.slopes[:edges]
    if fit_slopes(g.flat, g.patch, room.sides[:edges], g.half, vertices, slopes) > vertices.shape[1]:
        return WIDER_SLOPES
    weigh_sides(g.flat, bent, room.sides, of, room.across, room.ends)
    for k in range(count):
        for corner in range(3):
            faces[k, corner] = g.flat.faces[bent[k], corner]
    members, rows = room.members[:count], room.rows[:count]
    widest = gather(vertices, slopes, of, room.across, room.ends, faces, room.place, members, rows)
    most = bends.vertices.shape[1]
    if widest > most:
        return WIDER_ROWS
    for k in range(count):
        t = bent[k]
        for row in range(3):
            size = 0.0
            for m in range(most):
                there = m < widest
                bends.vertices[3 * t + row, m] = members[k, m] if there else faces[k, 0]
                bends.coefficients[3 * t + row, m] = rows[k, row, m] if there else 0.0
                size += abs(bends.coefficients[3 * t + row, m])
            stiffness = g.area[t] * g.plate[t, row]
            # What is left of curvatures that no vertices tell is rounding.
            bends.stiffness[3 * t + row] = stiffness if size * g.area[t] > NOTHING else 0.0
            for m in range(most):
                g.found.of_vertex[bends.vertices[3 * t + row, m]] = True
    g.found.counts[ROWS] = collect(g.found.of_vertex, g.found.rows)
    return widest
