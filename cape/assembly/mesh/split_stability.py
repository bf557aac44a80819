"""The largest step that an explicit solver may take where a mesh has just split, from what is near.

Where edges part, vertices get lighter and springs other stiffness. The fastest motions are those of few vertices: those
at springs that have changed are taken to move, and all others to stand still, which is a part of the whole matrix.
"""

import math
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assembly.membrane import FAR_STRETCH, USUAL_STRETCH, Membrane, stiffened
from cape.assembly.mesh.links import bent_at
from cape.assembly.mesh.split_springs import Changed, SplitMeshSprings, sides_of
from cape.assembly.stability import Ground, largest_eigenvalue, stable_step
from cape.cloth.fabric import Fabric

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

SETTLED = 1e-3  # relative change of the largest frequency's square at which it is known: less than what others add


class Nearby(NamedTuple):
    """What acts on some vertices (n,), and their `number` among these, n for all others, shape (N,)."""

    vertices: IntArray
    number: IntArray
    springs: IntArray
    bends: IntArray
    triangles: IntArray


def steps_near(
    springs: SplitMeshSprings,
    changed: Changed,
    fabric: Fabric,
    inverse_mass: FloatArray,
    positions: FloatArray,
    ground: Ground | None = None,
) -> tuple[float, float]:
    """Largest stable steps [s] of the vertices around what has changed: of a cloth at rest, and strained at will.

    Arrays are as in `stability.largest_step`.
    """
    near = _nearby(springs, changed, len(inverse_mass))
    own, stiffness = inverse_mass[near.vertices], springs.bend_stiffness[near.bends]
    members, coefficients = near.number[springs.bend_vertices[near.bends]], springs.bend_coefficients[near.bends]
    bending, root = _products(members, coefficients, members, coefficients, stiffness, len(own)), np.sqrt(own)
    size = np.abs(coefficients)
    entries = stiffness[:, None] * size * size.sum(axis=1, keepdims=True)
    row = np.bincount(members.ravel(), entries.ravel(), len(own) + 1)[:-1]
    rate = fabric.bend_damping_time * float((row * own).max())
    if ground is not None:
        bending += np.diag(ground.stiffness[near.vertices])
        rate += float((ground.damping[near.vertices] * own).max())
    steps: list[float] = []
    for places, axes in ((positions, 3), (None, 1)):
        matrix = _in_plane(springs, near, places)
        for axis in range(axes):
            matrix[axis::axes, axis::axes] += bending
        scale = np.repeat(root, axes)
        matrix *= scale[:, None] * scale
        start = np.random.default_rng(0).standard_normal(len(scale)) * (scale > 0.0)
        # Sums are numpy's own, which have the same bits on any number of cores.
        squared = max(largest_eigenvalue(partial(np.einsum, "ij,j->i", matrix), start, settled=SETTLED), 0.0)
        steps.append(stable_step(math.sqrt(squared), rate + fabric.damping_time * squared))
    return steps[0], steps[1]


def _nearby(springs: SplitMeshSprings, changed: Changed, count: int) -> Nearby:
    slots = changed.slots[springs.acts(changed.slots)]
    vertices = np.unique(np.concatenate([springs.first[slots], springs.second[slots], changed.rows]))
    number = np.full(count, len(vertices))
    number[vertices] = np.arange(len(vertices))
    moves = number < len(vertices)
    links = np.flatnonzero((moves[springs.first] | moves[springs.second]) & (springs.stiffness > 0.0))
    bends, triangles = sides_of(bent_at(springs, moves)), np.unique(np.flatnonzero(moves[springs.faces]) // 3)
    return Nearby(vertices, number, links, bends, triangles)


def _products(
    members: IntArray, values: FloatArray, others: IntArray, by: FloatArray, stiffness: FloatArray, count: int
) -> FloatArray:
    """Sums of k a b' over rows of values (e, m) of some members (e, m), and of others; of the first n, shape (n, n)."""
    place = members[:, :, None] * (count + 1) + others[:, None]
    values = (stiffness[:, None] * values)[:, :, None] * by[:, None]
    table = np.bincount(place.ravel(), values.ravel(), (count + 1) ** 2).reshape(count + 1, count + 1)
    return table[:count, :count].astype(float)


def _in_plane(springs: SplitMeshSprings, near: Nearby, positions: FloatArray | None) -> FloatArray:
    """The matrix of springs or of a membrane [N/m], shape (3 n, 3 n), or (n, n) without positions."""
    if springs.membrane is not None:
        part, place = springs.membrane.among(near.triangles)
        corners = np.concatenate([-part.slopes.sum(axis=1, keepdims=True), part.slopes], axis=1)
        if positions is None:
            return _bound_of_membrane(part, place, corners[place], near)
        return _of_membrane(part, place, corners, near, positions)
    first, second = springs.first[near.springs], springs.second[near.springs]
    direction = np.ones((len(first), 1))
    if positions is not None:
        direction = positions[second] - positions[first]
        direction /= np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-12)
    ends, values = _by_axis(near, np.stack([first, second], axis=1), direction[:, None] * [[-1.0], [1.0]])
    return _products(
        ends, values, ends, values, springs.stiffness[near.springs], len(near.vertices) * direction.shape[1]
    )


def _by_axis(near: Nearby, members: IntArray, values: FloatArray) -> tuple[IntArray, FloatArray]:
    """Values (e, m, D) of vertices (e, m), as rows (e, m D), and the numbers of vertices and axes that they are of."""
    axes = values.shape[2]
    last = len(near.vertices) * axes
    numbers = np.minimum(near.number[members][:, :, None] * axes + np.arange(axes), last)
    return numbers.reshape(len(members), -1), values.reshape(len(members), -1)


def _bound_of_membrane(part: Membrane, place: IntArray, corners: FloatArray, near: Nearby) -> FloatArray:
    """The matrix that bounds that of a membrane; `corners` (n, 3, 2) are slopes of triangles at places (n,)."""
    members, area = near.number[part.faces[place]], stiffened(FAR_STRETCH) * part.area[place]
    matrix = np.zeros((len(near.vertices), len(near.vertices)))
    for most, slopes in zip(part.bounds, corners.transpose(2, 0, 1), strict=True):
        matrix += _products(members, slopes, members, slopes, most * area, len(near.vertices))
    return matrix


def _of_membrane(
    part: Membrane, place: IntArray, corners: FloatArray, near: Nearby, positions: FloatArray
) -> FloatArray:
    """The matrix of a membrane at rest, stretched as it usually is: what triangles at some places (n,) smooth."""
    gradients, count = part.gradients(positions), 3 * len(near.vertices)
    gradients *= math.sqrt(stiffened(USUAL_STRETCH)) / np.linalg.norm(gradients, axis=2, keepdims=True)
    weft, warp = gradients[:, 0, None], gradients[:, 1, None]
    u, v = corners[:, :, :1], corners[:, :, 1:]
    strains = np.stack([u * weft, v * warp, v * weft + u * warp], axis=1)
    numbers, flat = _by_axis(near, np.repeat(part.faces, 3, axis=0), strains.reshape(-1, 3, 3))
    numbers, flat = numbers.reshape(-1, 3, 9), flat.reshape(-1, 3, 9)
    drawn = np.einsum("cd,tdm->tcm", part.stiffness, flat)
    shares = np.concatenate([part.own[place, None], part.share[place]], axis=1)
    beside = np.concatenate([place[:, None], part.neighbours[place]], axis=1)
    matrix = np.zeros((count, count))
    for other, share in zip(beside.T, shares.T, strict=True):
        left, right = (
            (numbers[at].reshape(-1, 9), of[at].reshape(-1, 9)) for at, of in ((place, flat), (other, drawn))
        )
        matrix += _products(*left, *right, np.repeat(share * part.area[place], 3), count)
    return 0.5 * (matrix + matrix.T)
