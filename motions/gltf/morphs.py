"""Morph targets of a glTF file (3.7.2.2): what moves a mesh's vertices before its bones do, and when.

A mesh counts as it is by the weights that its node or itself states; what an animation makes of them is told as a
difference from these. So whoever knows nothing of morphs has the mesh as the file states it.
"""

from collections.abc import Container, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from motions.errors import FileError
from motions.gltf.accessors import require_sane, values_of
from motions.gltf.document import Document
from motions.gltf.nodes import Nodes

FloatArray = NDArray[np.float64]


class Shape(NamedTuple):
    """A primitive's vertices and normals by the stated weights, and the K targets that an animation moves.

    Attributes:
        vertices: shape (V, 3).
        normals: not of unit length where targets change them, shape (V, 3); None for none.
        targets: shape (K, V, 3); None for none.
        normal_targets: shape (K, V, 3); None where normals stay.
        target_morphs: number of the morph of each, shape (K,); None for none.
    """

    vertices: FloatArray
    normals: FloatArray | None
    targets: FloatArray | None = None
    normal_targets: FloatArray | None = None
    target_morphs: NDArray[np.int64] | None = None


@dataclass(eq=False)
class Morphs:
    """The morphs of a file, as they are gathered.

    Attributes:
        document: the file.
        moved: weights over F frames of the targets of each node whose mesh an animation morphs, shape (F, n) each.
    """

    document: Document
    moved: Mapping[int, FloatArray] = field(default_factory=dict)
    _columns: dict[tuple[int, int], FloatArray] = field(default_factory=dict)

    def weights(self) -> FloatArray | None:
        """By how much all morphs exceed the stated weights, shape (F, M); None where there is none."""
        return np.stack(list(self._columns.values()), axis=1) if self._columns else None

    def shape(
        self, number: int, primitive: Mapping[str, Any], vertices: FloatArray, normals: FloatArray | None
    ) -> Shape:
        """A primitive of the mesh of a node, whose vertices and normals are as its attributes have them.

        Raises:
            FileError: its targets are damaged, or not of this mesh.
        """
        targets = primitive.get("targets", ())
        stated = stated_weights(self.document, number, len(targets))
        changes = self.moved.get(number, stated[None])[:, : len(targets)] - stated
        found: list[tuple[FloatArray, FloatArray | None, int]] = []
        for k, target in enumerate(targets):
            moving = bool(changes[:, k].any())
            if not (moving or stated[k]):
                continue
            moves = self._moves(target, "POSITION", len(vertices))
            turns = None if normals is None else self._moves(target, "NORMAL", len(vertices))
            vertices = vertices if moves is None else vertices + stated[k] * moves
            normals = normals if turns is None or normals is None else normals + stated[k] * turns
            if moving and moves is not None:
                self._columns.setdefault((number, k), changes[:, k])
                found.append((moves, turns, list(self._columns).index((number, k))))
        if not found:
            return Shape(vertices, normals)
        moves, turns, morphs = zip(*found, strict=True)
        still = np.zeros_like(vertices)
        turned = None
        if any(each is not None for each in turns):
            turned = np.stack([still if each is None else each for each in turns])
        return Shape(vertices, normals, np.stack(moves), turned, np.array(morphs))

    def _moves(self, target: Mapping[str, Any], name: str, count: int) -> FloatArray | None:
        """What a target adds to an attribute, shape (V, 3); None where it adds nothing."""
        if name not in target:
            return None
        values = values_of(self.document, target[name], of="VEC3", what="morph targets")
        if len(values) != count:
            raise FileError(f"{self.document.label}: a morph target moves {len(values)} vertices of {count}")
        return values


def stated_weights(document: Document, number: int, count: int) -> FloatArray:
    """Weights of the targets of a node's mesh: the node's, else the mesh's, else 0, shape (n,).

    Raises:
        FileError: one is no number that makes sense.
    """
    node = document.list_of("nodes")[number]
    stated: Sequence[float] = node.get("weights", document.list_of("meshes")[node["mesh"]].get("weights", ()))
    found = np.zeros(count)
    few = np.array(stated, dtype=float).ravel()[:count]
    found[: len(few)] = few
    require_sane(document, found, "weights of morph targets")
    return found


def target_counts(document: Document, nodes: Nodes, joints: Container[int]) -> dict[int, int]:
    """How many targets the mesh of each node has, by the node's number, where it has any and joints carry it."""
    found = {}
    for number, node in enumerate(document.list_of("nodes")):
        if "mesh" in node and ("skin" in node or nodes.carrier(number, joints) is not None):
            mesh = document.list_of("meshes")[node["mesh"]]
            count = max((len(each.get("targets", ())) for each in mesh["primitives"]), default=0)
            if count:
                found[number] = count
    return found
