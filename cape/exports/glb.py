"""Binary glTF 2.0: a morph target for each frame but the first, faded in and out by a linear animation.

Y up, metres, seconds; one material, metallic-roughness, with the albedo in the file. Positions and normals move. Some
viewers hold no more than the 2,048 targets that WebGL 2 usually has layers for.
After the glTF 2.0 specification (Khronos, 2021): 3.6.2 accessors, 3.7.2.2 morph targets, 3.9 materials, 3.11
animations. A character that has a mesh comes along, as `figure.glb` tells.
"""

# pygltflib states that texts and numbers may be left out, which its types don't.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false

from pathlib import Path
from typing import Any

import numpy as np

from cape.cloth.normals import vertex_normals
from cape.exports.figure.glb import add_figure
from cape.exports.gltf_parts import Buffer, save, with_material
from cape.exports.moving_mesh import MovingMesh, y_up
from motions.errors import ValueRangeError

LARGEST = 2**32 - 2**24  # bytes: a GLB tells its length in 32 bits


def write(mesh: MovingMesh, path: Path) -> tuple[Path]:
    """Write the file; gives its path.

    Raises:
        ValueRangeError: it would be larger than a GLB can be.
        FileError: it can't be written.
    """
    require_size(*mesh.positions.shape[:2])
    buffer = Buffer()
    save(_gltf(mesh, buffer), buffer, path)
    return (path,)


def require_size(frames: int, vertices: int) -> None:
    """Check that a file can hold so many frames.

    Raises:
        ValueRangeError: it can't.
    """
    if (size := frames * (24 * vertices + 4 * frames)) > LARGEST:
        raise ValueRangeError(f"{frames} frames are too many for a GLB: it would have {size / 2**30:.1f} GB, not 4")


def _gltf(mesh: MovingMesh, buffer: Buffer) -> Any:
    import pygltflib as g

    gltf, frames = with_material(mesh, buffer), len(mesh.times)
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
    if frames > 1:
        weights = np.eye(frames, frames - 1, k=-1, dtype=np.float32).ravel()
        sampler = g.AnimationSampler(
            input=buffer.add(mesh.times.astype(np.float32), bounded=True), output=buffer.add(weights)
        )
        channel = g.AnimationChannel(sampler=0, target=g.AnimationChannelTarget(node=0, path="weights"))
        gltf.animations = [g.Animation(name=mesh.name, samplers=[sampler], channels=[channel])]
    add_figure(gltf, mesh, buffer)
    return gltf
