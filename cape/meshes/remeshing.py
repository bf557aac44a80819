"""A mesh of even edges over the same surface, after Botsch and Kobbelt 2004, "A Remeshing Approach to Multiresolution
Modeling", section 4: long edges are split, short ones collapse, edges turn where that evens the number of neighbours,
and vertices move to the middle of theirs within the surface."""

import numpy as np

from cape.cloth.triangle_mesh import edges_of
from cape.meshes.nearest import nearest_on
from cape.meshes.patch import FloatArray, Patch
from cape.meshes.source import IntArray, Source
from motions.errors import ValueRangeError
from motions.limits import MOST_CLOTH_VERTICES

LONG, SHORT = 4.0 / 3.0, 4.0 / 5.0  # of the spacing: an edge beyond is split, one below collapses
ROUNDS = 6
MOVED = 0.6  # of the way to the middle of its neighbours that a vertex goes in a round
VERTEX_AREA = np.sqrt(3.0) / 2.0  # of the squared spacing that is a vertex's own where all triangles are equilateral


def remeshed(source: Source, spacing: float) -> Source:
    """Give a mesh edges of about one length; its border stays where it is, and maps go along by the nearest place.

    Texture coordinates do not: what is drawn keeps them.

    Args:
        source: a clean mesh.
        spacing: length of an edge [m].

    Raises:
        ValueRangeError: the spacing is not positive, wider than the mesh, or so fine that there would be too many
            vertices.
    """
    corners = source.positions[source.triangles]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1).sum() / 2.0
    extent = float(np.ptp(source.positions, axis=0).max())
    if not 0.0 < spacing < extent:
        raise ValueRangeError(f"the spacing of a mesh {extent:.3g} m across must be above 0 and below, not {spacing}")
    if (count := area / (VERTEX_AREA * spacing**2)) > MOST_CLOTH_VERTICES:
        raise ValueRangeError(f"a spacing of {spacing:g} m gives {count:.0f} vertices, more than {MOST_CLOTH_VERTICES}")
    patch = Patch(source.positions, source.triangles)
    for _ in range(ROUNDS):
        patch.split(LONG * spacing)
        patch.collapse(SHORT * spacing, LONG * spacing)
        patch.turn()
        positions, triangles = patch.arrays()
        patch = Patch(_evened(positions, triangles, source), triangles)
    positions, triangles = patch.arrays()
    near = nearest_on(positions, source.positions, source.triangles)
    held = source.triangles[near.triangles]
    weights = {name: np.sum(near.shares * values[held], axis=1) for name, values in source.weights.items()}
    note = f"{len(source.positions)} vertices remeshed to {len(positions)}, {spacing:g} m apart"
    return Source(positions, triangles, None, weights, source.textures, (*source.notes, note))


def _evened(positions: FloatArray, triangles: IntArray, source: Source) -> FloatArray:
    """Move inner vertices to the middle of their neighbours and back to the surface, shape (V, 3)."""
    edges = edges_of(triangles)
    count = len(positions)
    middles, valence = np.zeros((count, 3)), np.bincount(edges.vertices.ravel(), minlength=count)
    for one, other in (edges.vertices.T, edges.vertices.T[::-1]):
        np.add.at(middles, one, positions[other])
    inner = np.ones(count, dtype=bool)
    inner[edges.vertices[edges.triangles == 1]] = False
    moved = positions.copy()
    moved[inner] += MOVED * (middles[inner] / valence[inner, None] - positions[inner])
    near = nearest_on(moved[inner], source.positions, source.triangles)
    moved[inner] = np.einsum("nc,nck->nk", near.shares, source.positions[source.triangles[near.triangles]])
    return moved
