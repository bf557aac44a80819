"""Triangle meshes: what makes one a cloth, how its triangles lie flat, and in which order its vertices lie close."""

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from cape.cloth.cloth import MeshCloth, areas
from motions.errors import ValueRangeError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

# A triangle thinner than this, area over squared longest side, has no area: its cotangents would swamp all others.
SMALLEST, LARGEST = 1e-5, 1e6  # m that a mesh reaches
THINNEST = 1e-7
# A triangle is level when the vertical makes less than this of a unit vector in its plane; its warp then goes along -X.
LEVEL = 0.05


@dataclass(frozen=True, eq=False)
class Mesh:
    """A checked triangle mesh.

    Attributes:
        positions: [m], shape (V, 3).
        triangles: vertex indices, shape (T, 3).
        pattern: for texture coordinates [m], shape (V, 2).
        corners: of each triangle where it has no tension, laid flat: along the weft and the warp [m], shape (T, 3, 2).
    """

    positions: FloatArray
    triangles: IntArray
    pattern: FloatArray
    corners: FloatArray


class Edges(NamedTuple):
    """Edges of a mesh.

    `vertices` (E, 2), the lower index first; `of_triangle` (T, 3), the edge from each corner to the next; `triangles`
    (E,), how many each belongs to; `interior` (I,), those that belong to two; `sides` (I, 2), their two places 3 t + c:
    triangle t has the edge from its corner c to the next.
    """

    vertices: IntArray
    of_triangle: IntArray
    triangles: IntArray
    interior: IntArray
    sides: IntArray


def check_mesh(positions: ArrayLike, triangles: ArrayLike, pattern: ArrayLike | None = None) -> Mesh:
    """Check a mesh and lay its triangles flat.

    Args:
        positions: of the vertices [m], shape (V, 3).
        triangles: vertex indices, shape (T, 3).
        pattern: the flat pattern, along the weft and the warp [m], shape (V, 2); None to take the positions' own shape,
            with the warp threads of each triangle as vertical as its plane allows, along -X where it is level.

    Raises:
        ValueRangeError: a shape or a size is wrong, a number is not finite, an index is outside, a triangle has no
            area, is there twice or starts with two corners at one place, an edge belongs to more than two triangles,
            or a vertex to none.
    """
    points = _finite(positions, "positions", 3)
    if len(points) and not SMALLEST <= (size := float(np.abs(points - points[0]).max())) <= LARGEST:
        raise ValueRangeError(
            f"the mesh reaches {size:.3g} m: positions are in metres, from {SMALLEST:g} to {LARGEST:g}"
        )
    faces = _array(triangles, "triangles")
    if faces.ndim != 2 or faces.shape[1] != 3 or len(faces) == 0:
        raise ValueRangeError(f"triangles must have the shape (T, 3) with at least one, not {faces.shape}")
    if faces.dtype.kind not in "iu":
        raise ValueRangeError(f"triangles are given by whole numbers, not by {faces.dtype}")
    faces = faces.astype(np.int64)
    _check_indices(faces, len(points))
    if pattern is None:
        corners = _lay_flat(points[faces])
        flat = _principal_plane(points)
    else:
        flat = _finite(pattern, "pattern", 2)
        if len(flat) != len(points):
            raise ValueRangeError(f"the pattern has {len(flat)} vertices, but the mesh has {len(points)}")
        corners = flat[faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    if (empty := areas(corners) <= THINNEST * longest**2).any():
        first = int(np.flatnonzero(empty)[0])
        raise ValueRangeError(f"triangle {first} with vertices {_listed(faces[first])} has no area")
    _check_places(faces, points)
    _check_edges(faces)
    return Mesh(points, faces, flat, corners)


def edges_of(triangles: NDArray[np.integer]) -> Edges:
    """Find the edges of a mesh in which no edge belongs to more than two triangles."""
    corners = triangles.astype(np.int64)
    ends = np.sort(np.stack([corners, np.roll(corners, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    # One number for each pair is sorted eight times as fast as pairs are.
    base = int(ends.max(initial=0)) + 1
    keys, of_side, count = np.unique(ends[:, 0] * base + ends[:, 1], return_inverse=True, return_counts=True)
    vertices = np.stack(np.divmod(keys, base), axis=1)
    by_edge = np.argsort(of_side, kind="stable")
    start = np.cumsum(count) - count
    interior = np.flatnonzero(count == 2)
    sides = by_edge[start[interior, None] + np.arange(2)]
    return Edges(vertices, of_side.reshape(-1, 3), count, interior, sides)


def locality_order(triangles: IntArray, positions: FloatArray) -> IntArray:
    """Order vertices so that neighbours lie close in memory: entry i is the vertex that becomes number i, shape (V,).

    Reverse Cuthill-McKee: breadth first from a vertex at the border of the mesh, neighbours of few neighbours first;
    the positions, shape (V, 3), choose where each connected piece starts: at its end along the mesh's longest extent.
    """
    count = len(positions)
    pairs = edges_of(triangles).vertices
    both = np.concatenate([pairs, pairs[:, ::-1]])
    both = both[np.argsort(both[:, 0], kind="stable")]
    degree = np.bincount(both[:, 0], minlength=count)
    start = np.concatenate([[0], np.cumsum(degree)])
    # Neighbours of each vertex, those of few neighbours first.
    neighbours = both[np.lexsort((degree[both[:, 1]], both[:, 0])), 1].tolist()
    starts = start.tolist()
    axis = int(np.argmax(np.ptp(positions, axis=0)))
    seen = np.zeros(count, dtype=bool).tolist()
    order: list[int] = []
    for seed in np.argsort(positions[:, axis], kind="stable").tolist():
        if seen[seed]:
            continue
        seen[seed] = True
        head = len(order)
        order.append(seed)
        while head < len(order):
            vertex = order[head]
            head += 1
            for other in neighbours[starts[vertex] : starts[vertex + 1]]:
                if not seen[other]:
                    seen[other] = True
                    order.append(other)
    return np.array(order[::-1], dtype=np.int64)


def reordered(cloth: MeshCloth, order: IntArray) -> MeshCloth:
    """Renumber the vertices of a cloth: number i becomes what was `order[i]`; the triangles follow their vertices."""
    number = np.empty_like(order)
    number[order] = np.arange(len(order))
    faces = number[cloth.faces]
    follow = np.argsort(faces.min(axis=1), kind="stable")
    return replace(
        cloth,
        pattern=cloth.pattern[order],
        positions=cloth.positions[order],
        rest=None if cloth.rest is None else cloth.rest[order],
        faces=faces[follow],
        corners=cloth.corners[follow],
        threads=None if cloth.threads is None else np.sort(number[cloth.threads], axis=1),
        layers=None if cloth.layers is None else cloth.layers[follow],
        patchwork=None if cloth.patchwork is None else cloth.patchwork.in_order(follow),
        regions={name: number[region] for name, region in cloth.regions.items()},
    )


def _finite(values: ArrayLike, name: str, columns: int) -> FloatArray:
    array = _array(values, name, float)
    if array.ndim != 2 or array.shape[1] != columns:
        raise ValueRangeError(f"{name} must have the shape (V, {columns}), not {array.shape}")
    if not (finite := np.isfinite(array).all(axis=1)).all():
        raise ValueRangeError(f"{name} of vertex {np.flatnonzero(~finite)[0]} are not finite")
    return array


def _array(values: ArrayLike, name: str, dtype: type | None = None) -> NDArray[Any]:
    try:
        return np.array(values, dtype=dtype)
    except (ValueError, TypeError) as error:
        raise ValueRangeError(f"{name} are not rows of equally many numbers: {error}") from error


def _check_indices(faces: IntArray, vertices: int) -> None:
    if (outside := ((faces < 0) | (faces >= vertices)).any(axis=1)).any():
        first = int(np.flatnonzero(outside)[0])
        raise ValueRangeError(
            f"triangle {first} with vertices {_listed(faces[first])} is outside of a mesh of {vertices} vertices"
        )
    used = np.bincount(faces.ravel(), minlength=vertices) > 0
    if not used.all():
        raise ValueRangeError(f"vertex {np.flatnonzero(~used)[0]} belongs to no triangle")


def _check_places(faces: IntArray, points: FloatArray) -> None:
    ahead = np.roll(faces, -1, axis=1)
    together = (points[faces] == points[ahead]).all(axis=2)
    if together.any():
        first, corner = np.argwhere(together)[0]
        raise ValueRangeError(
            f"vertices {faces[first, corner]} and {ahead[first, corner]} of triangle {first} start at the same place"
        )


def _check_edges(faces: IntArray) -> None:
    edges = edges_of(faces)
    if (crowded := edges.triangles > 2).any():
        first = int(np.flatnonzero(crowded)[0])
        raise ValueRangeError(
            f"the edge of vertices {_listed(edges.vertices[first])} belongs to {edges.triangles[first]} triangles, "
            "more than two"
        )
    _, first_seen, count = np.unique(np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True)
    if (count > 1).any():
        first = int(first_seen[count > 1].min())
        raise ValueRangeError(f"triangle {first} with vertices {_listed(faces[first])} is there twice")


def _listed(indices: IntArray) -> str:
    return ", ".join(str(int(i)) for i in indices)


def _threads(normals: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit vectors along weft and warp in the planes of unit normals, each of shape (T, 3)."""
    down, back = np.array([0.0, 0.0, -1.0]), np.array([-1.0, 0.0, 0.0])
    warp = down - (normals @ down)[:, None] * normals
    level = np.linalg.norm(warp, axis=1) < LEVEL
    warp[level] = back - (normals[level] @ back)[:, None] * normals[level]
    warp /= np.linalg.norm(warp, axis=1, keepdims=True)
    return np.asarray(np.cross(warp, normals), dtype=float), warp


def _lay_flat(points: FloatArray) -> FloatArray:
    """Triangles (T, 3, 3) in their own planes, along weft and warp from the first corner [m], shape (T, 3, 2)."""
    p, q = points[:, 1] - points[:, 0], points[:, 2] - points[:, 0]
    normals = np.cross(p, q)
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    # A triangle without area has no plane; it is refused later, for its area.
    normals = np.where(lengths > 0.0, normals, (1.0, 0.0, 0.0)) / np.where(lengths > 0.0, lengths, 1.0)
    weft, warp = _threads(normals)
    offsets = points - points[:, :1]
    return np.stack([np.einsum("tck,tk->tc", offsets, weft), np.einsum("tck,tk->tc", offsets, warp)], axis=2)


def _principal_plane(points: FloatArray) -> FloatArray:
    """Points projected to the plane in which they spread most, along its weft and warp [m], shape (V, 2)."""
    centred = points - points.mean(axis=0)
    _, axes = np.linalg.eigh(centred.T @ centred)
    weft, warp = _threads(np.asarray(axes[None, :, 0], dtype=float))
    return centred @ np.concatenate([weft, warp]).T
