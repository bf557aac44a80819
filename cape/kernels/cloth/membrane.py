"""Forces of a membrane of triangles whose strains are averaged over edges; see `cape.assembly.membrane`.

Triangles belong to one of their corners and stand in rows by block as the links of `cape.kernels.cloth.mesh`. Three
passes, between which the threads of a team meet:

1. `strain`: F and the strains of each triangle, with what damping adds to them;
2. `pull_corners`: the smoothed strains, from a triangle's own and its three neighbours', its tension, and its forces on
   its three corners, of which the owner's are added up at once;
3. `mesh.collect`: the forces that others' triangles keep for a vertex.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.cloth.mesh import BLOCK, ENDS, NEXT, collect, damping_of, fetch, pack, take
from cape.kernels.jit import inlined, kernel, routine, unit
from cape.kernels.state import State
from cape.kernels.team import meet

Array = NDArray[np.floating]
Indices = NDArray[np.int64]

SHAPE = 6 * BLOCK  # numbers that a row of F fills


class Tension(NamedTuple):
    """C [N/m]: along the weft, along the warp, what couples both, shear."""

    weft: float
    warp: float
    coupling: float
    shear: float


class MeshMembrane(NamedTuple):
    """Triangles of a mesh, each owned by one corner: D rows for each block of vertices.

    `second` and `third` (blocks, D, BLOCK) are the other corners, `slopes` [1/m] (blocks, D, 4, BLOCK) F's from these,
    `neighbours` (blocks, D, 3, BLOCK) the places in `strains` of the neighbours', `smoothing` [m2] (blocks, D, 4,
    BLOCK) the area times the shares of its own strain and theirs. `sorted_vertices`, `start`, `incoming`, `words` and
    `room` as in MeshSprings. Room: `shape`, F by columns, six components of BLOCK for each row; `strains`, three for
    each row; `forces` [N], on the second and the third corner, six for each row, and a row of zeros for padding.
    Of a piece of a mesh `used` (blocks,) tells how many rows of each block have triangles of it; None for all.
    """

    tension: Tension
    second: NDArray[np.uint32]
    third: NDArray[np.uint32]
    slopes: Array
    neighbours: NDArray[np.uint32]
    smoothing: Array
    sorted_vertices: NDArray[np.uint32]
    start: Indices
    incoming: NDArray[np.uint32]
    words: NDArray[np.generic]
    room: NDArray[np.generic]
    shape: Array
    strains: Array
    forces: Array
    used: Indices | None = None


class MembraneForces(NamedTuple):
    """A membrane, which sets `forces` (3, N) [N]; `damping` is its damping time [s], None for none."""

    state: State
    membrane: MeshMembrane
    damping: float | None
    forces: Array


@unit
def mesh_membrane(g, team, substep, substeps, step):
    """Set the forces on a thread's vertices to those of the membrane."""
    s, m, f, lo, hi = g.state, g.membrane, g.forces, team.lo, team.hi
    pack(lo, hi, s.x, s.y, s.z, s.vx, s.vy, s.vz, m.words)
    meet(team)
    find_strains(g, lo, hi)
    meet(team)
    pull_all(g, lo, hi)
    meet(team)
    collect(lo, hi, m.sorted_vertices, m.start, m.incoming, m.forces, f[0], f[1], f[2])


@routine
def find_strains(g, lo, hi):
    """Pass on what `strain` needs."""
    s, m = g.state, g.membrane
    strain(
        lo, hi, s.x, s.y, s.z, s.vx, s.vy, s.vz, m.words, m.second, m.third, m.slopes, damping_of(g.damping, s.x),
        s.x.dtype.type(0.5), m.room, m.used, m.shape, m.strains,
    )  # fmt: skip


@routine
def pull_all(g, lo, hi):
    """Pass on what `pull_corners` needs."""
    m, c, f, dtype = g.membrane, g.membrane.tension, g.forces, g.state.x.dtype.type
    pull_corners(
        lo, hi, m.slopes, m.neighbours, m.smoothing, m.shape, m.strains, dtype(c.weft), dtype(c.warp),
        dtype(c.coupling), dtype(c.shear), m.room, m.used, m.forces, f[0], f[1], f[2],
    )  # fmt: skip


@inlined
def depth_of(used, block, rows):
    """How many rows of a block have triangles."""
    if used is None:
        return rows
    return used[block]


@kernel
def strain(lo, hi, x, y, z, vx, vy, vz, words, second, third, slopes, damping, half, room, used, shape, strains):
    """Set F and the strains of the triangles that vertices lo to hi own; `half` is 1/2."""
    ends = room[lo // BLOCK]
    corners = ends.view(x.dtype)
    own, others = corners[4 * ENDS :], ends[ENDS:]
    rows = second.shape[1]
    for block in range((lo + BLOCK - 1) // BLOCK, (hi + BLOCK - 1) // BLOCK):
        start = block * BLOCK
        n = min(BLOCK, hi - start)
        take(n, x[start:], y[start:], z[start:], own)
        take(n, vx[start:], vy[start:], vz[start:], own[3 * BLOCK :])
        for d in range(depth_of(used, block, rows)):
            fetch(second[block, d], words[0], words[1], words[2], ends)
            fetch(third[block, d], words[0], words[1], words[2], others)
            row = block * rows + d
            strain_row(
                corners, corners[2 * ENDS :], own, slopes[block, d], damping, half, shape[row * SHAPE :],
                strains[row * ENDS :],
            )  # fmt: skip


@inlined
def strain_row(a, b, own, slopes, damping, half, shape, strains):
    """One row of triangles: `a` and `b` hold the other corners' coordinates and velocities in turns."""
    for i in range(BLOCK):
        x, y, z = 2 * i, 2 * (BLOCK + i), 2 * (2 * BLOCK + i)
        p, q, r, s = slopes[0, i], slopes[1, i], slopes[2, i], slopes[3, i]
        ax, ay, az = a[x] - own[i], a[y] - own[BLOCK + i], a[z] - own[2 * BLOCK + i]
        bx, by, bz = b[x] - own[i], b[y] - own[BLOCK + i], b[z] - own[2 * BLOCK + i]
        ux, uy, uz = p * ax + r * bx, p * ay + r * by, p * az + r * bz
        wx, wy, wz = q * ax + s * bx, q * ay + s * by, q * az + s * bz
        shape[i], shape[BLOCK + i], shape[2 * BLOCK + i] = ux, uy, uz
        shape[3 * BLOCK + i], shape[4 * BLOCK + i], shape[5 * BLOCK + i] = wx, wy, wz
        cx, cy, cz = a[x + 1] - own[3 * BLOCK + i], a[y + 1] - own[4 * BLOCK + i], a[z + 1] - own[5 * BLOCK + i]
        dx, dy, dz = b[x + 1] - own[3 * BLOCK + i], b[y + 1] - own[4 * BLOCK + i], b[z + 1] - own[5 * BLOCK + i]
        # Half of F plus its rate times the damping time: its product with F is the strain with damping, but for 1/2.
        fx = half * ux + damping * (p * cx + r * dx)
        fy = half * uy + damping * (p * cy + r * dy)
        fz = half * uz + damping * (p * cz + r * dz)
        gx = half * wx + damping * (q * cx + s * dx)
        gy = half * wy + damping * (q * cy + s * dy)
        gz = half * wz + damping * (q * cz + s * dz)
        strains[i] = ux * fx + uy * fy + uz * fz - half
        strains[BLOCK + i] = wx * gx + wy * gy + wz * gz - half
        strains[2 * BLOCK + i] = (ux * gx + uy * gy + uz * gz) + (wx * fx + wy * fy + wz * fz)


@kernel
def pull_corners(
    lo, hi, slopes, neighbours, smoothing, shape, strains, weft, warp, coupling, shear, room, used, forces,
    fx, fy, fz,
):  # fmt: skip
    """Set `f` to the forces of the triangles that vertices lo to hi own on them, keep those on the other corners."""
    smooth = room[lo // BLOCK].view(strains.dtype)
    total = smooth[ENDS:]
    rows = slopes.shape[1]
    for block in range((lo + BLOCK - 1) // BLOCK, (hi + BLOCK - 1) // BLOCK):
        start = block * BLOCK
        for i in range(3 * BLOCK):
            total[i] = 0
        for d in range(depth_of(used, block, rows)):
            row = block * rows + d
            smooth_row(neighbours[block, d], smoothing[block, d], row * ENDS, strains, smooth)
            pull_row(
                slopes[block, d], shape[row * SHAPE :], smooth, weft, warp, coupling, shear,
                forces[2 * row * ENDS :], total,
            )  # fmt: skip
        for i in range(min(BLOCK, hi - start)):
            fx[start + i], fy[start + i], fz[start + i] = total[i], total[BLOCK + i], total[2 * BLOCK + i]


@inlined
def smooth_row(neighbours, smoothing, place, strains, smooth):
    """Smoothed strains of a row of triangles times their areas; their own strains stand from `place` on."""
    for i in range(BLOCK):
        at = np.uint64(place + i)
        a, b, c = np.uint64(neighbours[0, i]), np.uint64(neighbours[1, i]), np.uint64(neighbours[2, i])
        p, q, r, s = smoothing[0, i], smoothing[1, i], smoothing[2, i], smoothing[3, i]
        smooth[i] = p * strains[at] + q * strains[a] + r * strains[b] + s * strains[c]
        at, a, b, c = at + NEXT, a + NEXT, b + NEXT, c + NEXT
        smooth[BLOCK + i] = p * strains[at] + q * strains[a] + r * strains[b] + s * strains[c]
        at, a, b, c = at + NEXT, a + NEXT, b + NEXT, c + NEXT
        smooth[2 * BLOCK + i] = p * strains[at] + q * strains[a] + r * strains[b] + s * strains[c]


@inlined
def pull_row(slopes, shape, smooth, weft, warp, coupling, shear, forces, total):
    """Forces of one row of triangles, whose smoothed strains times their areas are given."""
    for i in range(BLOCK):
        e, f = smooth[i], smooth[BLOCK + i]
        along, across, mixed = weft * e + coupling * f, warp * f + coupling * e, shear * smooth[2 * BLOCK + i]
        ux, uy, uz = shape[i], shape[BLOCK + i], shape[2 * BLOCK + i]
        wx, wy, wz = shape[3 * BLOCK + i], shape[4 * BLOCK + i], shape[5 * BLOCK + i]
        spread(
            i, slopes, along * ux + mixed * wx, along * uy + mixed * wy, along * uz + mixed * wz,
            across * wx + mixed * ux, across * wy + mixed * uy, across * wz + mixed * uz, forces, total,
        )  # fmt: skip


@inlined
def spread(i, slopes, ux, uy, uz, wx, wy, wz, forces, total):
    """Pulls on the slopes of triangle i become forces: kept for its other corners, added at its own."""
    p, q, r, s = slopes[0, i], slopes[1, i], slopes[2, i], slopes[3, i]
    ax, ay, az = p * ux + q * wx, p * uy + q * wy, p * uz + q * wz
    bx, by, bz = r * ux + s * wx, r * uy + s * wy, r * uz + s * wz
    forces[i], forces[BLOCK + i], forces[2 * BLOCK + i] = -ax, -ay, -az
    forces[ENDS + i], forces[ENDS + BLOCK + i], forces[ENDS + 2 * BLOCK + i] = -bx, -by, -bz
    total[i] += ax + bx
    total[BLOCK + i] += ay + by
    total[2 * BLOCK + i] += az + bz
