"""Letting a cloth out where the body is thicker than the one that it was modelled on."""

import numpy as np
from numpy.typing import NDArray

from cape.cloth.normals import vertex_normals
from cape.cloth.triangle_mesh import edges_of
from cape.garments.fitting import Fitted

FloatArray = NDArray[np.float64]

STEP = 0.004  # m
FARTHEST = 0.16  # m that a vertex is moved in a round
ROUNDS = 4
SPREAD = 12  # neighbours over which a shift fades


def let_out(positions: FloatArray, triangles: NDArray[np.integer], fitted: Fitted, clearance: float) -> FloatArray:
    """Move vertices that are too near to a body out of it, along the cloth's normals, shape (V, 3).

    Along these rather than the shortest way out, which parts neighbours that lie on both sides of a limb's middle.
    Their neighbours come along, less with each edge between. What finds no way out within 0.16 m stays.

    Args:
        positions: in the wearer's frame [m], shape (V, 3).
        triangles: all turned alike, shape (T, 3).
        fitted: the body.
        clearance: least distance from it [m].
    """
    positions = positions.copy()
    edges = edges_of(triangles).vertices
    for _ in range(ROUNDS):
        distances = fitted.distances(positions, within=FARTHEST)
        near = np.flatnonzero(distances < clearance)
        if not len(near):
            break
        outwards = _outwards(positions, triangles, fitted, clearance)
        shifts = np.zeros(len(positions))
        waiting = near
        for way in np.arange(STEP, FARTHEST, STEP):
            clear = fitted.distances(positions[waiting] + way * outwards[waiting], within=clearance) >= clearance
            shifts[waiting[clear]] = way
            waiting = waiting[~clear]
            if not len(waiting):
                break
        positions += _spread(shifts, edges)[:, None] * outwards
    return positions


def _outwards(positions: FloatArray, triangles: NDArray[np.integer], fitted: Fitted, clearance: float) -> FloatArray:
    """Unit normals on the side of the cloth that is away from the body, shape (V, 3)."""
    normals = vertex_normals(positions[None], triangles)[0].astype(float)
    ahead, behind = (fitted.distances(positions + sign * clearance * normals) for sign in (1.0, -1.0))
    near = np.minimum(ahead, behind) < 2.0 * clearance
    return normals if (ahead - behind)[near].sum() >= 0.0 else -normals


def _spread(shifts: FloatArray, edges: NDArray[np.int64]) -> FloatArray:
    """Raise each vertex' shift to the mean of its neighbours', over and over, shape (V,)."""
    counts = np.bincount(edges.ravel(), minlength=len(shifts))
    for _ in range(SPREAD):
        total = np.bincount(edges[:, 0], weights=shifts[edges[:, 1]], minlength=len(shifts))
        total += np.bincount(edges[:, 1], weights=shifts[edges[:, 0]], minlength=len(shifts))
        shifts = np.maximum(shifts, total / counts)
    return shifts
