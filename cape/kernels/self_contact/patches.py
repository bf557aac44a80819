"""Patches of a cloth: what each sweeps, and which may touch.

Boxes of neighbouring patches always overlap. Where all their normals are within 60 degrees of one direction the cloth
can't touch itself, since its points are at least half as far apart as along the cloth (Volino and Magnenat-Thalmann
1994, "Efficient self-collision detection on smoothly discretized surface animations using geometrical shape
regularity", section 3).
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.jit import inlined, kernel, routine
from cape.kernels.self_contact.tree import Tree

FloatArray = NDArray[np.float64]
Indices = NDArray[np.int64]

WIDEST = 2.0 * math.pi / 3.0  # angle between any two normals up to which neighbouring patches can't touch
FAR = 0.05  # m that fast vertices are foreseen to go: the edges of a tear whip about, past much that they never meet
SAMPLE = 16  # one vertex in so many tells how the cloth moves as a whole
TINY = 1e-12  # m2, of a way that is none


class Patches(NamedTuple):
    """P patches of neighbouring triangles: each triangle, edge and vertex belongs to one of them.

    `vertices` (N,), `triangles` (3, T) and `edges` (2, E) are sorted by patch, with where each patch starts (P + 1,);
    `neighbors` are the patches that share a vertex with a patch, with where each patch starts. `rest` (3, N) [m] is the
    cloth without tension.
    """

    vertices: NDArray[np.uint32]
    vertex_start: Indices
    triangles: NDArray[np.uint32]
    triangle_start: Indices
    edges: NDArray[np.uint32]
    edge_start: Indices
    neighbors: NDArray[np.uint32]
    neighbor_start: Indices
    rest: FloatArray


class Sight(NamedTuple):
    """What a search saw: `places` (6, N) of the vertices and their ways from there, relative to their mean [m].

    And scratch: boxes, lowest and highest coordinates, of what vertices (6, N), triangles (6, T) and edges (6, E)
    sweep; normals of the triangles, unnormalised (3, T), and the patches' cones of them, axis and half angle (P, 4);
    the patches' `tree`; `picked` (6, most), what of either patch of a pair is near the other, and `matched`
    (2, most * most), which of that come near each other.
    """

    places: FloatArray
    vertex_boxes: FloatArray
    triangle_boxes: FloatArray
    edge_boxes: FloatArray
    normals: FloatArray
    cones: FloatArray
    tree: Tree
    picked: NDArray[np.uint32]
    matched: NDArray[np.uint32]


@routine
def is_foreseen(s, places, ahead, limit):
    """Tell whether all vertices will, `ahead` seconds from now, be within a limit [m] of where they were foreseen."""
    strayed = count_strayed(
        s.x, s.y, s.z, s.vx, s.vy, s.vz, places[0], places[1], places[2], places[3], places[4], places[5], ahead,
        sample_mean(s.x) + ahead * sample_mean(s.vx), sample_mean(s.y) + ahead * sample_mean(s.vy),
        sample_mean(s.z) + ahead * sample_mean(s.vz), limit * limit,
    )  # fmt: skip
    return strayed == 0


@inlined
def sample_mean(values):
    """Mean over one vertex in `SAMPLE`."""
    total, count = 0.0, 0
    for i in range(0, values.size, SAMPLE):
        total += values[i]
        count += 1
    return total / count


@kernel
def count_strayed(x, y, z, vx, vy, vz, px, py, pz, wx, wy, wz, ahead, mx, my, mz, limit):
    """Number of vertices that will be, relative to m, off the way from p along w by at least the root of a limit."""
    count = 0
    for i in range(x.size):
        dx = x[i] + ahead * vx[i] - mx - px[i]
        dy = y[i] + ahead * vy[i] - my - py[i]
        dz = z[i] + ahead * vz[i] - mz - pz[i]
        share = (dx * wx[i] + dy * wy[i] + dz * wz[i]) / (wx[i] * wx[i] + wy[i] * wy[i] + wz[i] * wz[i] + TINY)
        share = min(max(share, 0.0), 1.0)
        dx, dy, dz = dx - share * wx[i], dy - share * wy[i], dz - share * wz[i]
        if not (dx * dx + dy * dy + dz * dz < limit):
            count += 1
    return count


@routine
def look(s, least, ahead, places):
    """Note where vertices are, relative to their mean, and how they go on for `ahead` seconds.

    Fast ones are foreseen for `FAR` only, but for `least` seconds: what is on a long way is much, and soon left behind.
    """
    mx, my, mz = sample_mean(s.x), sample_mean(s.y), sample_mean(s.z)
    u, v, w = sample_mean(s.vx), sample_mean(s.vy), sample_mean(s.vz)
    for i in range(s.x.size):
        vx, vy, vz = s.vx[i] - u, s.vy[i] - v, s.vz[i] - w
        speed = math.sqrt(vx * vx + vy * vy + vz * vz)
        time = ahead
        if speed * ahead > FAR:
            time = max(FAR / speed, least)
        places[0, i], places[1, i], places[2, i] = s.x[i] - mx, s.y[i] - my, s.z[i] - mz
        places[3, i], places[4, i], places[5, i] = time * vx, time * vy, time * vz


@routine
def sweep_all(triangles, edges, sight, reach):
    """Box what vertices, triangles and edges sweep, with half the reach around, and set the triangles' normals."""
    p, v, t, e, n = sight.places, sight.vertex_boxes, sight.triangle_boxes, sight.edge_boxes, sight.normals
    for axis in range(3):
        sweep(p[axis], p[axis + 3], 0.5 * reach, v[axis], v[axis + 3])
        box_triangles(triangles[0], triangles[1], triangles[2], v[axis], v[axis + 3], t[axis], t[axis + 3])
        box_edges(edges[0], edges[1], v[axis], v[axis + 3], e[axis], e[axis + 3])
    set_normals(triangles[0], triangles[1], triangles[2], p[0], p[1], p[2], n[0], n[1], n[2])


@kernel
def sweep(x, way, around, low, high):
    """Lowest and highest coordinate of what moves on, with some room around, along one axis."""
    for i in range(x.size):
        end = x[i] + way[i]
        low[i] = (x[i] if x[i] < end else end) - around
        high[i] = (end if x[i] < end else x[i]) + around


@kernel
def box_triangles(first, second, third, vertex_low, vertex_high, low, high):
    """Lowest and highest coordinate of triangles from those of vertices, along one axis."""
    for t in range(first.size):
        a, b, c = vertex_low[first[t]], vertex_low[second[t]], vertex_low[third[t]]
        d = a if a < b else b
        low[t] = d if d < c else c
        a, b, c = vertex_high[first[t]], vertex_high[second[t]], vertex_high[third[t]]
        d = a if a > b else b
        high[t] = d if d > c else c


@kernel
def box_edges(first, second, vertex_low, vertex_high, low, high):
    """Lowest and highest coordinate of edges from those of vertices, along one axis."""
    for e in range(first.size):
        a, b = vertex_low[first[e]], vertex_low[second[e]]
        low[e] = a if a < b else b
        a, b = vertex_high[first[e]], vertex_high[second[e]]
        high[e] = a if a > b else b


@kernel
def set_normals(first, second, third, x, y, z, nx, ny, nz):
    """Set n to the normals of triangles, as long as twice their areas [m2]."""
    for t in range(first.size):
        a, b, c = first[t], second[t], third[t]
        ux, uy, uz = x[b] - x[a], y[b] - y[a], z[b] - z[a]
        vx, vy, vz = x[c] - x[a], y[c] - y[a], z[c] - z[a]
        nx[t] = uy * vz - uz * vy
        ny[t] = uz * vx - ux * vz
        nz[t] = ux * vy - uy * vx


@routine
def set_cones(start, normals, cones):
    """Set the cones of the patches' normals."""
    for p in range(cones.shape[0]):
        mx = my = mz = 0.0
        for t in range(start[p], start[p + 1]):
            mx, my, mz = mx + normals[0, t], my + normals[1, t], mz + normals[2, t]
        length, least = math.sqrt(mx * mx + my * my + mz * mz), 1.0
        for t in range(start[p], start[p + 1]):
            nx, ny, nz = np.float64(normals[0, t]), np.float64(normals[1, t]), np.float64(normals[2, t])
            size = length * math.sqrt(nx * nx + ny * ny + nz * nz)
            # A triangle without area has no normal: it opens the cone.
            cosine = (nx * mx + ny * my + nz * mz) / size if size > 0.0 else -1.0
            least = cosine if cosine < least else least
        if length > 0.0:
            cones[p, 0], cones[p, 1], cones[p, 2] = mx / length, my / length, mz / length
        cones[p, 3] = math.acos(max(least, -1.0))


@inlined
def are_neighbors(patches, a, b):
    """Tell whether two patches share a vertex, or are the same."""
    found = a == b
    for k in range(patches.neighbor_start[a], patches.neighbor_start[a + 1]):
        found |= patches.neighbors[k] == b
    return found


@inlined
def is_calm(cones, a, b):
    """Tell whether all normals of two patches are within 60 degrees of one direction."""
    between = cones[a, 0] * cones[b, 0] + cones[a, 1] * cones[b, 1] + cones[a, 2] * cones[b, 2]
    free = WIDEST - cones[a, 3] - cones[b, 3]
    return free > 0.0 and between > math.cos(free)
