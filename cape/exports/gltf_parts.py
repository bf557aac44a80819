"""What all glTF files have in common: a buffer that grows, the cloth's material, and the file around it."""

# pygltflib states that texts and numbers may be left out, which its types don't.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cape.exports.moving_mesh import MovingMesh
from cape.version import VERSION
from motions.files import whole_file

KINDS = {
    np.dtype(np.float32): 5126,
    np.dtype(np.uint32): 5125,
    np.dtype(np.uint16): 5123,
    np.dtype(np.uint8): 5121,
}  # as the format numbers them


def with_material(mesh: MovingMesh, buffer: "Buffer") -> Any:
    """A glTF that has nothing yet but the cloth's material, of index 0, with its texture."""
    import pygltflib as g

    gltf = g.GLTF2(asset=g.Asset(generator=f"cape {VERSION}"))
    surface = g.PbrMetallicRoughness(
        baseColorTexture=g.TextureInfo(index=0), metallicFactor=0.0, roughnessFactor=mesh.look.rough
    )
    gltf.materials = [g.Material(name="cape", pbrMetallicRoughness=surface, doubleSided=True)]
    gltf.images = [g.Image(bufferView=buffer.view(mesh.texture_png()), mimeType="image/png")]
    gltf.samplers = [g.Sampler(magFilter=g.LINEAR, minFilter=g.LINEAR_MIPMAP_LINEAR, wrapS=g.CLAMP_TO_EDGE,
                               wrapT=g.CLAMP_TO_EDGE)]  # fmt: skip
    gltf.textures = [g.Texture(sampler=0, source=0)]
    return gltf


def save(gltf: Any, buffer: "Buffer", path: Path) -> None:
    """Write a file with its buffer.

    Raises:
        FileError: it can't be written.
    """
    import pygltflib as g

    gltf.accessors, gltf.bufferViews = buffer.accessors, buffer.views
    data = b"".join(buffer.parts)
    gltf.buffers = [g.Buffer(byteLength=len(data))]
    gltf.set_binary_blob(data)
    with whole_file(path) as partial, partial.open("wb") as file:
        for part in gltf.save_to_bytes():
            file.write(part)


def summing_to_one(weights: NDArray[np.float64]) -> NDArray[np.float32]:
    """Weights whose sums are one in single precision as well, as validators want them."""
    rounded = weights.astype(np.float32)
    largest = rounded.argmax(axis=1, keepdims=True)
    off = 1.0 - rounded.sum(axis=1, keepdims=True, dtype=np.float32)
    np.put_along_axis(rounded, largest, np.take_along_axis(rounded, largest, axis=1) + off, axis=1)
    return rounded


class Buffer:
    """The file's one buffer, as it grows: arrays one after the other, each with a view and an accessor of its own."""

    def __init__(self) -> None:
        """An empty buffer."""
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
        """Add numbers (n,), vectors (n, k) or matrices (n, 4, 4), which are written column by column; with their bounds
        where the format wants them. Gives their accessor."""
        import pygltflib as g

        form = (g.SCALAR, f"VEC{array.shape[-1]}", g.MAT4)[array.ndim - 1]
        data = np.ascontiguousarray(array.swapaxes(1, 2) if array.ndim == 3 else array).tobytes()
        accessor = g.Accessor(bufferView=self.view(data), componentType=KINDS[array.dtype], count=len(array), type=form)
        if bounded:
            accessor.min = np.atleast_1d(array.min(axis=0)).tolist()
            accessor.max = np.atleast_1d(array.max(axis=0)).tolist()
        self.accessors.append(accessor)
        return len(self.accessors) - 1
