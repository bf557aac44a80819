"""GLB, the binary form of glTF 2.0: geometry, `_` attributes, skin weights and the textures of its material.

Read here rather than by trimesh, which drops attributes and skins: an accessor is a view of the bytes, and all those of
a vertex are then read alike. Section numbers are of the specification, Khronos 2021, registry.khronos.org/glTF.
"""

import json
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cape.cloth.drawn.textures import Textures, decoded
from cape.meshes.source import FloatArray, Source, add_weight, upright
from motions import quaternions
from motions.errors import FileError, UserError

JSON, BIN = 0x4E4F534A, 0x004E4942
KINDS = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}  # 3.6.2.2
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
TRIANGLES = 4
COMPRESSED = ("KHR_draco_mesh_compression", "EXT_meshopt_compression")


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
    try:
        return _File(data, label).mesh(up)
    except UserError:
        raise
    except (KeyError, IndexError, TypeError, ValueError, AttributeError, struct.error, RecursionError) as error:
        raise FileError(f"{label} is no GLB that can be read: {type(error).__name__}: {error}") from None


class _File:
    """A file's description and bytes, and what of its scene has been gathered."""

    def __init__(self, data: bytes, label: str) -> None:
        """Take the two chunks apart (4.4)."""
        self._label = label
        magic, version, _ = struct.unpack_from("<4sII", data)
        if magic != b"glTF" or version != 2:
            raise FileError(f"{label} is no GLB of version 2")
        chunks: dict[int, bytes] = {}
        place = 12
        while place + 8 <= len(data):
            length, kind = struct.unpack_from("<II", data, place)
            chunks.setdefault(kind, data[place + 8 : place + 8 + length])
            place += 8 + length
        self._top: dict[str, Any] = json.loads(chunks[JSON])
        self._bytes = chunks.get(BIN, b"")
        for extension in COMPRESSED:
            if extension in self._top.get("extensionsRequired", ()):
                raise FileError(f"{label} is compressed by {extension}: save it without")
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
        world = above @ _local(node)
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
        accessor = self._top["accessors"][number]
        if "sparse" in accessor or "bufferView" not in accessor:
            raise FileError(f"{self._label} has a sparse accessor: save it without")
        kind, width = np.dtype(KINDS[accessor["componentType"]]), WIDTHS[accessor["type"]]
        view = self._top["bufferViews"][accessor["bufferView"]]
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        stride, count = view.get("byteStride", kind.itemsize * width), accessor["count"]
        end = start + stride * (count - 1) + kind.itemsize * width
        if min(start, count - 1, stride - kind.itemsize * width) < 0 or end > len(self._bytes):
            raise FileError(f"{self._label}: accessor {number} reaches beyond the file's {len(self._bytes)} bytes")
        raw = np.frombuffer(self._bytes, np.uint8, end - start, start)
        rows = np.lib.stride_tricks.as_strided(raw, (count, kind.itemsize * width), (stride, 1), writeable=False)
        values = np.ascontiguousarray(rows).view(kind).astype(float)
        return values / np.iinfo(kind).max if accessor.get("normalized") else values

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
        view = self._top["bufferViews"][image["bufferView"]]
        start = view.get("byteOffset", 0)
        return decoded(self._bytes[start : start + view["byteLength"]], f"image {number} of {self._label}")


def _local(node: dict[str, Any]) -> FloatArray:
    """A node's transform to its parent, shape (4, 4) (3.5.2)."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=float).reshape(4, 4).T
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    found = np.eye(4)
    found[:3, :3] = quaternions.to_matrix(np.array([w, x, y, z], dtype=float)) * node.get("scale", (1.0, 1.0, 1.0))
    found[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return found
