"""Binary glTF 2.0: a morph target for each frame but the first, faded in and out by a linear animation.

Y up, metres, seconds; one material, metallic-roughness, with the albedo in the file. Positions and normals move. Some
viewers hold no more than the 2,048 targets that WebGL 2 usually has layers for.
After the glTF 2.0 specification (Khronos, 2021): 3.6.2 accessors, 3.7.2.2 morph targets, 3.9 materials, 3.11
animations.
"""

# pygltflib states that texts and numbers may be left out, which its types don't.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cape.cloth.normals import vertex_normals
from cape.exports.moving_mesh import MovingMesh, y_up
from cape.version import VERSION
from motions.errors import ValueRangeError
from motions.files import whole_file

LARGEST = 2**32 - 2**24  # bytes: a GLB tells its length in 32 bits


def write(mesh: MovingMesh, path: Path) -> tuple[Path]:
    """Write the file; gives its path.

    Raises:
        ValueRangeError: it would be larger than a GLB can be.
        FileError: it can't be written.
    """
    frames, vertices = mesh.positions.shape[:2]
    if (size := frames * (24 * vertices + 4 * frames)) > LARGEST:
        raise ValueRangeError(f"{frames} frames are too many for a GLB: it would have {size / 2**30:.1f} GB, not 4")
    with whole_file(path) as partial, partial.open("wb") as file:
        for part in _gltf(mesh).save_to_bytes():
            file.write(part)
    return (path,)


def _gltf(mesh: MovingMesh) -> Any:
    import pygltflib as g

    gltf, buffer = g.GLTF2(asset=g.Asset(generator=f"cape {VERSION}")), _Buffer()
    frames = len(mesh.times)
    places = y_up(mesh.positions)
    normals = y_up(vertex_normals(mesh.positions, mesh.triangles))
    attributes = g.Attributes(
        POSITION=buffer.add(places[0], bounded=True),
        NORMAL=buffer.add(normals[0]),
        TEXCOORD_0=buffer.add(mesh.texcoords),
    )
    primitive = g.Primitive(attributes=attributes, indices=buffer.add(mesh.triangles.ravel().astype(np.uint32)))
    primitive.material = 0
    primitive.targets = [
        {"POSITION": buffer.add(places[k] - places[0], bounded=True), "NORMAL": buffer.add(normals[k] - normals[0])}
        for k in range(1, frames)
    ]
    gltf.meshes = [g.Mesh(name="cape", primitives=[primitive], weights=[0.0] * (frames - 1) or None)]
    gltf.nodes, gltf.scenes, gltf.scene = [g.Node(name="cape", mesh=0)], [g.Scene(name=mesh.name, nodes=[0])], 0
    surface = g.PbrMetallicRoughness(
        baseColorTexture=g.TextureInfo(index=0), metallicFactor=0.0, roughnessFactor=mesh.look.rough
    )
    gltf.materials = [g.Material(name="cape", pbrMetallicRoughness=surface, doubleSided=True)]
    gltf.images = [g.Image(bufferView=buffer.view(mesh.texture_png()), mimeType="image/png")]
    gltf.samplers = [g.Sampler(magFilter=g.LINEAR, minFilter=g.LINEAR_MIPMAP_LINEAR, wrapS=g.CLAMP_TO_EDGE,
                               wrapT=g.CLAMP_TO_EDGE)]  # fmt: skip
    gltf.textures = [g.Texture(sampler=0, source=0)]
    if frames > 1:
        weights = np.eye(frames, frames - 1, k=-1, dtype=np.float32).ravel()
        sampler = g.AnimationSampler(
            input=buffer.add(mesh.times.astype(np.float32), bounded=True), output=buffer.add(weights)
        )
        channel = g.AnimationChannel(sampler=0, target=g.AnimationChannelTarget(node=0, path="weights"))
        gltf.animations = [g.Animation(name=mesh.name, samplers=[sampler], channels=[channel])]
    gltf.accessors, gltf.bufferViews = buffer.accessors, buffer.views
    data = b"".join(buffer.parts)
    gltf.buffers = [g.Buffer(byteLength=len(data))]
    gltf.set_binary_blob(data)
    return gltf


class _Buffer:
    """The file's one buffer, as it grows: arrays one after the other, each with a view and an accessor of its own."""

    def __init__(self) -> None:
        self.parts: list[bytes] = []
        self.views: list[Any] = []
        self.accessors: list[Any] = []
        self._size = 0

    def view(self, data: bytes) -> int:
        """Add bytes, padded to whole words; gives the index of their view."""
        import pygltflib as g

        self.views.append(g.BufferView(buffer=0, byteOffset=self._size, byteLength=len(data)))
        self.parts.append(data + bytes(-len(data) % 4))
        self._size += len(self.parts[-1])
        return len(self.views) - 1

    def add(self, array: NDArray[Any], *, bounded: bool = False) -> int:
        """Add numbers (n,) or vectors (n, k), with their bounds where the format wants them; gives their accessor."""
        import pygltflib as g

        kind = {np.dtype(np.float32): g.FLOAT, np.dtype(np.uint32): g.UNSIGNED_INT}[array.dtype]
        form = g.SCALAR if array.ndim == 1 else f"VEC{array.shape[1]}"
        accessor = g.Accessor(bufferView=self.view(array.tobytes()), componentType=kind, count=len(array), type=form)
        if bounded:
            accessor.min = np.atleast_1d(array.min(axis=0)).tolist()
            accessor.max = np.atleast_1d(array.max(axis=0)).tolist()
        self.accessors.append(accessor)
        return len(self.accessors) - 1
