"""The nodes of a glTF file (3.5): which hangs at which, and each one's transform to the one above."""

from collections.abc import Container, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.errors import FileError
from motions.gltf.accessors import require_sane
from motions.gltf.document import Document

FloatArray = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Nodes:
    """All N nodes of a file, in the file's own unit and axes.

    Attributes:
        names: of the nodes, not necessarily unique.
        parents: index of the node above each, -1 for none.
        order: all indices, those above first.
        translations: node's origin in the frame of the one above, shape (N, 3).
        rotations_wxyz: unit quaternions node_to_parent, shape (N, 4).
        scales: along the node's own axes, shape (N, 3).
    """

    names: tuple[str, ...]
    parents: tuple[int, ...]
    order: tuple[int, ...]
    translations: FloatArray
    rotations_wxyz: FloatArray
    scales: FloatArray

    def above(self, node: int) -> list[int]:
        """The node and all that are above it, from below up."""
        way = [node]
        while (node := self.parents[node]) >= 0:
            way.append(node)
        return way

    def carrier(self, node: int, joints: Container[int]) -> int | None:
        """The first of some joints that is the node, or above it; None for none."""
        return next((above for above in self.above(node) if above in joints), None)

    def with_above(self, nodes: Iterable[int]) -> list[int]:
        """The nodes and all above them, those above first."""
        found = {above for node in nodes for above in self.above(node)}
        return [node for node in self.order if node in found]


def read_nodes(document: Document) -> Nodes:
    """Read the nodes.

    Raises:
        FileError: they are no forest, or a number isn't finite.
    """
    found = document.list_of("nodes")
    parents = [-1] * len(found)
    for number, node in enumerate(found):
        for child in node.get("children", ()):
            if parents[child] >= 0 or child < 0:
                raise FileError(f"{document.label}: node {child} hangs at two others")
            parents[child] = number
    children: list[list[int]] = [[] for _ in found]
    for number, parent in enumerate(parents):
        if parent >= 0:
            children[parent].append(number)
    order = [number for number, parent in enumerate(parents) if parent < 0]
    for number in order:  # which grows meanwhile
        order += children[number]
    if len(order) < len(found):
        raise FileError(f"{document.label}: some nodes hang at each other in a circle")
    parts = [_parts(node) for node in found]
    arrays = [np.array(each, dtype=float).reshape(len(found), -1) for each in zip(*parts, strict=True)] or [
        np.zeros((0, width)) for width in (3, 4, 3)
    ]
    for each in arrays:
        require_sane(document, each, "nodes")
    names = tuple(str(node.get("name") or f"node {number}") for number, node in enumerate(found))
    return Nodes(names, tuple(parents), tuple(order), arrays[0], unit(arrays[1]), arrays[2])


def local_matrix(node: dict[str, Any]) -> FloatArray:
    """A node's transform to the one above, shape (4, 4) (3.5.2)."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=float).reshape(4, 4).T
    translation, rotation, scale = _parts(node)
    found = np.eye(4)
    found[:3, :3] = quaternions.to_matrix(np.array(rotation, dtype=float)) * scale
    found[:3, 3] = translation
    return found


def unit(rotations_wxyz: FloatArray) -> FloatArray:
    """Quaternions (..., 4) brought to unit length; those of no length stand for no rotation."""
    lengths = np.linalg.norm(rotations_wxyz, axis=-1, keepdims=True)
    whole = np.where(lengths > 1e-12, rotations_wxyz, np.array([1.0, 0.0, 0.0, 0.0]))
    return quaternions.normalize(whole)


def _parts(node: dict[str, Any]) -> tuple[Any, Any, Any]:
    """Translation, rotation wxyz and scale."""
    if "matrix" not in node:
        x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
        return node.get("translation", (0.0, 0.0, 0.0)), (w, x, y, z), node.get("scale", (1.0, 1.0, 1.0))
    matrix = local_matrix(node)
    turned, scales = matrix[:3, :3].copy(), np.linalg.norm(matrix[:3, :3], axis=0)
    if np.linalg.det(turned) < 0.0:
        scales[0] *= -1.0
    if not np.abs(scales).min() > 0.0:
        return matrix[:3, 3], (1.0, 0.0, 0.0, 0.0), scales
    return matrix[:3, 3], quaternions.from_matrix(turned / scales), scales
