"""A mesh that may have split, with spare vertices: what splits off takes those, and nothing else is renumbered."""

from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from cape.cloth.cloth import MeshCloth, areas
from cape.cloth.triangle_mesh import reordered
from motions.errors import ValueRangeError

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False, kw_only=True)
class SplitMesh(MeshCloth):
    """A mesh that may have split; its first vertices are those of the whole mesh, spare ones come last.

    Its `threads` are those of the whole mesh.

    Attributes:
        whole: the mesh before.
        order: the vertex that each one of the whole was before it was put in order, shape (V,).
        follow: the triangle that each one was before, shape (T,).
        parents: the vertex of the whole that each vertex in use is or was, shape (n,); those behind are spare.
        weights: mass that each corner of each triangle gets [kg], shape (3 T,).
    """

    whole: MeshCloth
    order: IntArray
    follow: IntArray
    parents: IntArray
    weights: FloatArray

    @staticmethod
    def of(mesh: MeshCloth, order: IntArray, spare: int) -> "SplitMesh":
        """A mesh, whole as yet, in another order of its vertices (V,), with so many spare ones."""
        whole = reordered(mesh, order)
        follow = np.argsort(np.argsort(order)[mesh.faces].min(axis=1), kind="stable")
        kept = {each.name: getattr(whole, each.name) for each in fields(MeshCloth)}
        layers = 1.0 if whole.layers is None else whole.layers
        density = whole.fabric.density
        if whole.patchwork is not None:
            density = whole.patchwork.of_triangles(lambda fabric: fabric.density)
        weights = np.repeat(areas(whole.corners) * layers * density / 3.0, 3)
        parents = np.arange(whole.vertices)
        split = SplitMesh(**kept, whole=whole, order=order, follow=follow, parents=parents, weights=weights)
        return split.with_spare(spare)

    def with_spare(self, spare: int) -> "SplitMesh":
        """The same with so many spare vertices."""
        where = np.concatenate([self.parents, np.zeros(spare, np.int64)])
        rest = None if self.whole.rest is None else self.whole.rest[where]
        return replace(self, pattern=self.whole.pattern[where], positions=self.whole.positions[where], rest=rest)

    def split(self, cells: IntArray, parents: IntArray) -> "SplitMesh":
        """The same mesh with other corners of its triangles (T, 3), and vertices in use (n,).

        Both are numbered as they were before it was put in order.

        Raises:
            ValueRangeError: there are more of them than there is room for.
        """
        count, used = len(self.order), len(parents)
        if used > self.vertices:
            raise ValueRangeError(f"a mesh with room for {self.vertices} vertices can't have {used}")
        number = np.concatenate([np.argsort(self.order), np.arange(count, used)])
        own = np.concatenate([np.arange(count), number[parents[count:]]])
        pattern, positions = self.pattern.copy(), self.positions.copy()
        pattern[:used], positions[:used] = self.whole.pattern[own], self.whole.positions[own]
        rest = None
        if self.whole.rest is not None:
            rest = self.whole.rest[np.concatenate([own, np.zeros(self.vertices - used, np.int64)])]
        moved = {"pattern": pattern, "positions": positions, "rest": rest}
        return replace(self, faces=number[cells[self.follow]], parents=own, **moved)

    def masses(self) -> FloatArray:
        """Mass of each vertex [kg], shape (V,): a third of that of its triangles, none of spare ones."""
        return np.bincount(self.faces.ravel(), self.weights, self.vertices).astype(float)

    @property
    def in_use(self) -> int:
        """How many vertices are no spare ones."""
        return len(self.parents)
