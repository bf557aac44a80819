"""The meshes that the joints of a glTF file carry (3.7): skinned, or fixed to one joint, with the colour of each."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motions.errors import FileError
from motions.gltf.accessors import values_of, whole_numbers_of
from motions.gltf.document import Document
from motions.gltf.morphs import Morphs
from motions.gltf.nodes import Nodes, local_matrix
from motions.limits import MOST_MESH_TRIANGLES
from motions.skin import Skin, SkinPiece

FloatArray = NDArray[np.float64]

TRIANGLES = 4
MOST_INFLUENCES = 4  # sets of four bones to a vertex: sixteen are more than any program writes


@dataclass(eq=False)
class Gathering:
    """The meshes of a file, as they are gathered.

    Attributes:
        document: the file.
        nodes: its nodes.
        joints: the joint's number of each node that is one.
        stretches: of each joint what of its transform is neither turn nor place, joint_to_joint, shape (J, 3, 3).
        morphs: what moves vertices before joints do.
        notes: what was left out, a sentence each.
    """

    document: Document
    nodes: Nodes
    joints: Mapping[int, int]
    stretches: FloatArray
    morphs: Morphs
    notes: list[str] = field(default_factory=list)
    _bones: list[int] = field(default_factory=list)
    _binds: list[FloatArray] = field(default_factory=list)
    _pieces: list[SkinPiece] = field(default_factory=list)
    _triangles: int = 0

    def skin(self, names: Sequence[str]) -> Skin | None:
        """All of it on joints of these names; None where they carry nothing.

        Raises:
            FileError: it is damaged, or too large.
        """
        first: dict[int, int] = {}
        for number, node in enumerate(self.document.list_of("nodes")):
            if "mesh" not in node:
                continue
            if "skin" in node:
                if node["skin"] not in first:
                    first[node["skin"]] = self._skinned(self.document.list_of("skins")[node["skin"]])
                self._take(node, number, first[node["skin"]])
            elif (carrier := self.nodes.carrier(number, self.joints)) is not None:
                self._take(node, number, self._fixed(number, carrier), fixed=True)
            else:
                self.notes.append(f"left out: the mesh {self.nodes.names[number]!r}, which no joint carries")
        if not self._pieces:
            return None
        return Skin(tuple(names[bone] for bone in self._bones), np.array(self._binds), tuple(self._pieces))

    def _skinned(self, skin: dict[str, Any]) -> int:
        """Number of the first of the bindings of a skin's joints (3.7.3)."""
        joints, inverse = skin["joints"], None
        if "inverseBindMatrices" in skin:
            inverse = values_of(self.document, skin["inverseBindMatrices"], of="MAT4", what="inverse bind matrices")
            inverse = inverse.reshape(-1, 4, 4).transpose(0, 2, 1)
            if len(inverse) < len(joints):
                raise FileError(f"{self.document.label}: a skin of {len(joints)} joints has {len(inverse)} matrices")
        first = len(self._binds)
        for k, joint in enumerate(joints):
            self._bind(joint, np.eye(4) if inverse is None else inverse[k])
        return first

    def _fixed(self, node: int, carrier: int) -> int:
        """Number of the binding of a mesh that hangs at a joint, or at what hangs at one."""
        way = np.eye(4)
        for above in self.nodes.above(node):
            if above == carrier:
                break
            way = local_matrix(self.document.list_of("nodes")[above]) @ way
        return self._bind(carrier, way)

    def _bind(self, node: int, mesh_to_node: FloatArray) -> int:
        joint = self.joints[node]
        self._bones.append(joint)
        self._binds.append(self.stretches[joint] @ mesh_to_node[:3])
        return len(self._binds) - 1

    def _take(self, node: dict[str, Any], number: int, first: int, *, fixed: bool = False) -> None:
        mesh = self.document.list_of("meshes")[node["mesh"]]
        name = str(mesh.get("name") or self.nodes.names[number])
        for primitive in mesh["primitives"]:
            if primitive.get("mode", TRIANGLES) != TRIANGLES:
                self.notes.append(f"left out: points, lines or strips of the mesh {name!r}")
                continue
            piece = self._piece(primitive, number, first, fixed=fixed, name=self._free_name(name))
            if piece is not None:
                self._pieces.append(piece)

    def _free_name(self, name: str) -> str:
        taken, number, free = {piece.name for piece in self._pieces}, 1, name
        while free in taken:
            number += 1
            free = f"{name}_{number}"
        return free

    def _piece(self, primitive: dict[str, Any], node: int, first: int, *, fixed: bool, name: str) -> SkinPiece | None:
        """A primitive, without vertices that belong to no triangle; None where it has none."""
        document, attributes = self.document, primitive["attributes"]
        vertices = values_of(document, attributes["POSITION"], of="VEC3", what="vertices")
        count = len(vertices)
        corners = np.arange(count)
        if "indices" in primitive:
            corners = whole_numbers_of(document, primitive["indices"], "SCALAR").ravel()
        if len(corners) % 3 or (len(corners) and corners.max() >= count):
            raise FileError(f"{document.label}: triangles of {name!r} have corners beyond its {count} vertices")
        self._triangles += len(corners) // 3
        if self._triangles > MOST_MESH_TRIANGLES:
            raise FileError(f"{document.label} has more than {MOST_MESH_TRIANGLES} triangles")
        if fixed:
            binds, weights = np.full((count, 1), first), np.ones((count, 1))
        else:
            binds, weights = self._influences(attributes, first, count, name)
        kept, triangles = np.unique(corners, return_inverse=True)
        if not len(kept):
            return None
        triangles = triangles.reshape(-1, 3)
        inside_out = np.linalg.det(np.array(self._binds)[np.unique(binds[kept]), :, :3]) < 0.0
        if inside_out.mean() > 0.5:
            triangles = triangles[:, ::-1]
        rgba, image, places = self._colour(primitive)
        normals, uv = (self._optional(attributes, each, count) for each in ("NORMAL", f"TEXCOORD_{places}"))
        shape = self.morphs.shape(node, primitive, vertices, normals)
        return SkinPiece(
            name,
            shape.vertices[kept],
            None if shape.normals is None else shape.normals[kept],
            triangles,
            binds[kept],
            weights[kept],
            None if uv is None else uv[kept],
            rgba,
            None if uv is None else image,
            None if shape.targets is None else shape.targets[:, kept],
            None if shape.normal_targets is None else shape.normal_targets[:, kept],
            shape.target_morphs,
        )

    def _influences(
        self, attributes: dict[str, Any], first: int, count: int, name: str
    ) -> tuple[NDArray[np.int64], FloatArray]:
        """Bindings and weights of a skinned primitive's vertices, shapes (V, K) (3.7.3.3)."""
        binds, weights = [], []
        for number in range(MOST_INFLUENCES):
            if f"JOINTS_{number}" not in attributes:
                break
            binds.append(whole_numbers_of(self.document, attributes[f"JOINTS_{number}"], "VEC4"))
            weights.append(values_of(self.document, attributes[f"WEIGHTS_{number}"], of="VEC4", what="skin weights"))
        if not binds:
            raise FileError(f"{self.document.label}: the mesh {name!r} has a skin, and no weights for it")
        joints, shares = np.concatenate(binds, axis=1), np.maximum(np.concatenate(weights, axis=1), 0.0)
        bones = len(self._binds) - first
        if len(joints) != count or len(shares) != count or joints[shares > 0.0].max(initial=0) >= bones:
            raise FileError(f"{self.document.label}: the mesh {name!r} hangs at joints that its skin does not have")
        joints = np.where(shares > 0.0, joints, 0)
        # What no bone moves goes along with the skin's first.
        shares[shares.sum(axis=1) == 0.0, 0] = 1.0
        counted = shares.any(axis=0)
        shares = shares[:, counted]
        return joints[:, counted] + first, shares / shares.sum(axis=1, keepdims=True)

    def _optional(self, attributes: dict[str, Any], name: str, count: int) -> FloatArray | None:
        if name not in attributes:
            return None
        values = values_of(self.document, attributes[name], of="VEC3" if name == "NORMAL" else "VEC2")
        return values if len(values) == count and np.isfinite(values).all() else None

    def _colour(self, primitive: dict[str, Any]) -> tuple[FloatArray | None, bytes | None, int]:
        """Colour, encoded image, and which texture coordinates lay it (3.9)."""
        if "material" not in primitive:
            return None, None, 0
        base = self.document.list_of("materials")[primitive["material"]].get("pbrMetallicRoughness", {})
        rgba = np.clip(np.array(base.get("baseColorFactor", (1.0, 1.0, 1.0, 1.0)), dtype=float), 0.0, 1.0)
        if rgba.shape != (4,) or not np.isfinite(rgba).all():
            rgba = np.ones(4)
        texture = base.get("baseColorTexture")
        return rgba, None if texture is None else self._image(texture["index"]), (texture or {}).get("texCoord", 0)

    def _image(self, texture: int) -> bytes | None:
        """The encoded image of a texture; None, and a note, where it can't be had."""
        source = self.document.list_of("textures")[texture].get("source")
        if source is None:
            self.notes.append(f"left out: texture {texture}, which is neither PNG nor JPEG")
            return None
        image = self.document.list_of("images")[source]
        try:
            if "bufferView" not in image:
                return self.document.bytes_at(image.get("uri"))
            data, start, length, _ = self.document.view(image["bufferView"])
            return data[start : start + length]
        except FileError as error:
            self.notes.append(f"left out: a texture, {error}")
            return None
