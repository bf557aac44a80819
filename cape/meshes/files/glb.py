"""GLB, the binary form of glTF 2.0: geometry, `_` attributes, skin weights and the textures of its material.

Read here rather than by trimesh, which drops attributes and skins: all accessors of a vertex are then read alike.
Section numbers are of the specification, Khronos 2021, registry.khronos.org/glTF.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cape.cloth.drawn.textures import Textures, decoded
from cape.meshes.source import FloatArray, Source, add_weight, upright
from motions.errors import FileError
from motions.gltf.accessors import values_of
from motions.gltf.document import Document, reading
from motions.gltf.nodes import local_matrix

TRIANGLES = 4


def read_glb(data: bytes, label: str, *, up: str = "y") -> Source:
    """The mesh in a GLB file, Y up and facing +Z: all meshes of its scene, each with a map named like it.

    Skins give a map for each bone by its name, `_NAME` attributes one named `NAME`. The texture coordinates are the
    first set; the textures are those of the first material that has any.

    Args:
        data: the file's bytes.
        label: what errors call the file.
        up: "y", or "as-is" to leave the axes as they are.

    Raises:
        FileError: it can't be read, is compressed, or has no triangle.
    """
    with reading(label, "GLB"):
        return _File(Document.of_glb(data, label)).mesh(up)


class _File:
    """A file's description and bytes, and what of its scene has been gathered."""

    def __init__(self, document: Document) -> None:
        self._document, self._label, self._top = document, document.label, document.top
        self._positions: list[FloatArray] = []
        self._triangles: list[NDArray[np.int64]] = []
        self._places: list[FloatArray | None] = []
        self._maps: list[tuple[str, int, FloatArray]] = []
        self._count = 0
        self._material: int | None = None
        self._notes: list[str] = []

    def mesh(self, up: str) -> Source:
        """All meshes of the scene as one."""
        nodes = self._top.get("nodes", [])
        below = {child for node in nodes for child in node.get("children", ())}
        scenes = self._top.get("scenes")
        roots = scenes[self._top.get("scene", 0)].get("nodes", ()) if scenes else set(range(len(nodes))) - below
        for root in roots:
            self._walk(root, np.eye(4))
        if not sum(len(each) for each in self._triangles):
            raise FileError(f"{self._label} has no triangle in its scene")
        weights: dict[str, FloatArray] = {}
        for name, first, values in self._maps:
            add_weight(weights, name, first + np.arange(len(values)), values, self._count)
        uv = None
        places = [each for each in self._places if each is not None]
        if len(places) == len(self._places):
            uv = np.concatenate(places)
        positions = upright(np.concatenate(self._positions), up)
        return Source(positions, np.concatenate(self._triangles), uv, weights, self._textures(), tuple(self._notes))

    def _walk(self, number: int, above: FloatArray) -> None:
        """Gather the meshes of a node and of those below, in coordinates of the scene."""
        node = self._top["nodes"][number]
        world = above @ local_matrix(node)
        if "mesh" in node:
            mesh = self._top["meshes"][node["mesh"]]
            skin = self._top["skins"][node["skin"]] if "skin" in node else None
            names = {name for name in (node.get("name"), mesh.get("name")) if name}
            for primitive in mesh["primitives"]:
                if primitive.get("mode", TRIANGLES) == TRIANGLES:
                    # A skinned mesh is in the coordinates of the scene: the node's transform is ignored (3.7.3.2).
                    self._take(primitive, np.eye(4) if skin else world, skin, names)
                else:
                    self._notes.append(f"points, lines or strips in {', '.join(sorted(names)) or 'a mesh'} left out")
        for child in node.get("children", ()):
            self._walk(child, world)

    def _take(self, primitive: dict[str, Any], world: FloatArray, skin: dict[str, Any] | None, names: set[str]) -> None:
        attributes = primitive["attributes"]
        points = self._values(attributes["POSITION"]).astype(float)
        count = len(points)
        if "indices" in primitive:
            corners = self._values(primitive["indices"]).astype(np.int64).ravel()
        else:
            corners = np.arange(count)
        if len(corners) % 3 or (len(corners) and corners.max() >= count):
            raise FileError(f"{self._label} has triangles with corners that are not among their {count} vertices")
        self._positions.append(points @ world[:3, :3].T + world[:3, 3])
        self._triangles.append(corners.reshape(-1, 3) + self._count)
        self._places.append(self._values(attributes["TEXCOORD_0"]) if "TEXCOORD_0" in attributes else None)
        maps = [(name, np.ones(count)) for name in sorted(names)]
        maps += [(name[1:], self._values(attributes[name])[:, 0]) for name in attributes if name.startswith("_")]
        maps += [] if skin is None else self._bones(attributes, skin)
        self._maps += [(name, self._count, np.clip(values, 0.0, 1.0)) for name, values in maps]
        self._count += count
        self._material = primitive.get("material") if self._material is None else self._material

    def _bones(self, attributes: dict[str, Any], skin: dict[str, Any]) -> list[tuple[str, FloatArray]]:
        """How much each bone of a skin carries each vertex."""
        nodes = self._top["nodes"]
        names = [nodes[joint].get("name", f"joint {joint}") for joint in skin["joints"]]
        count = self._top["accessors"][attributes["POSITION"]]["count"]
        shares = np.zeros((count, len(names)))
        number = 0
        while f"JOINTS_{number}" in attributes:
            joints = self._values(attributes[f"JOINTS_{number}"]).astype(np.int64)
            np.add.at(shares, (np.arange(count)[:, None], joints), self._values(attributes[f"WEIGHTS_{number}"]))
            number += 1
        return [(name, shares[:, k]) for k, name in enumerate(names) if shares[:, k].any()]

    def _values(self, number: int) -> FloatArray:
        """The numbers of an accessor, those of whole numbers that stand for 0 to 1 as these, shape (count, width)."""
        return values_of(self._document, number)

    def _textures(self) -> Textures | None:
        """Those of the material; None where it has no albedo."""
        material = {} if self._material is None else self._top["materials"][self._material]
        base = material.get("pbrMetallicRoughness", {})
        named = (base.get("baseColorTexture"), material.get("normalTexture"), base.get("metallicRoughnessTexture"))
        albedo, normal, metal = (None if each is None else self._image(each["index"]) for each in named)
        return None if albedo is None else Textures(albedo, normal, metal)

    def _image(self, number: int) -> NDArray[np.uint8] | None:
        image = self._top["images"][self._top["textures"][number]["source"]]
        if "bufferView" not in image:
            self._notes.append(f"texture {image.get('uri', number)} lies outside of the file and was left out")
            return None
        data, start, length, _ = self._document.view(image["bufferView"])
        return decoded(data[start : start + length], f"image {number} of {self._label}")
