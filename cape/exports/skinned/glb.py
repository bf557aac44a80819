"""Binary glTF 2.0 of a skinned mesh: joints in chains that move, and weights by which the vertices follow them.

Y up, metres, seconds. Joints hang on a still one at the origin, `cape_root`; keyframes are linear. After the glTF 2.0
specification (Khronos, 2021): 3.7.3 skins, 3.11 animations.
"""

# pygltflib states that texts and numbers may be left out, which its types don't.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cape.cloth.normals import vertex_normals
from cape.exports.figure.glb import add_figure
from cape.exports.gltf_parts import Buffer, save, summing_to_one, with_material
from cape.exports.moving_mesh import MovingMesh, y_up
from cape.exports.skinned.fit import Skin, fit
from cape.exports.skinned.joints import spread
from motions import quaternions
from motions.errors import ValueRangeError

MOST = 256  # joints: their numbers are bytes


def write(mesh: MovingMesh, path: Path, *, joints: int, held: NDArray[np.int64]) -> Skin:
    """Write the file; gives what is in it, Z up.

    Args:
        mesh: what moves.
        path: the file.
        joints: how many, at most one for each vertex.
        held: vertices that are held, where chains begin.

    Raises:
        ValueRangeError: so many joints make no sense.
        FileError: it can't be written.
    """
    most = min(MOST, mesh.positions.shape[1])
    if not 1 <= joints <= most:
        raise ValueRangeError(f"this cloth can have 1 to {most} joints, not {joints}")
    positions = mesh.positions.astype(np.float64)
    chains = spread(positions[0], mesh.triangles, held, joints)
    skin = fit(positions, chains)
    buffer = Buffer()
    save(_gltf(mesh, skin, chains.parents, buffer), buffer, path)
    return skin


def _gltf(mesh: MovingMesh, skin: Skin, parents: NDArray[np.intp], buffer: Buffer) -> Any:
    import pygltflib as g

    gltf, count = with_material(mesh, buffer), len(parents)
    attributes = g.Attributes(
        POSITION=buffer.add(_turned(skin.rest), bounded=True),
        NORMAL=buffer.add(_turned(vertex_normals(skin.rest[None], mesh.triangles)[0])),
        TEXCOORD_0=buffer.add(mesh.texcoords),
        JOINTS_0=buffer.add(skin.influences.astype(np.uint8)),
        WEIGHTS_0=buffer.add(summing_to_one(skin.weights)),
    )
    primitive = g.Primitive(attributes=attributes, indices=buffer.add(mesh.triangles.ravel().astype(np.uint32)))
    primitive.material = 0
    gltf.meshes = [g.Mesh(name="cape", primitives=[primitive])]

    centers = _turned(skin.centers)
    inverse = np.tile(np.eye(4, dtype=np.float32), (count, 1, 1))
    inverse[:, :3, 3] = -centers
    root, first = 1, 2  # nodes: the mesh, the root, the joints
    apart = np.where(parents[:, None] < 0, centers, centers - centers[parents])
    nodes = [
        g.Node(
            name=f"cape_{k:03}", translation=apart[k].tolist(), children=(first + np.flatnonzero(parents == k)).tolist()
        )
        for k in range(count)
    ]
    still = g.Node(name="cape_root", children=(first + np.flatnonzero(parents < 0)).tolist())
    gltf.nodes = [g.Node(name="cape", mesh=0, skin=0), still, *nodes]
    gltf.skins = [
        g.Skin(inverseBindMatrices=buffer.add(inverse), joints=list(range(first, first + count)), skeleton=root)
    ]
    gltf.scenes, gltf.scene = [g.Scene(name=mesh.name, nodes=[0, root])], 0
    gltf.animations = [_animation(mesh, skin, parents, buffer, first)]
    add_figure(gltf, mesh, buffer)
    return gltf


def _animation(mesh: MovingMesh, skin: Skin, parents: NDArray[np.intp], buffer: Buffer, first: int) -> Any:
    import pygltflib as g

    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # as `y_up` turns vectors
    rotations, places = turn @ skin.rotations @ turn.T, skin.places @ turn.T
    animation, times = g.Animation(name=mesh.name), buffer.add(mesh.times.astype(np.float32), bounded=True)
    for k, parent in enumerate(parents):
        own, at = rotations[:, k], places[:, k]
        if parent >= 0:
            back = rotations[:, parent].transpose(0, 2, 1)
            own, at = back @ own, np.einsum("fij,fj->fi", back, at - places[:, parent])
        wxyz = quaternions.make_continuous(quaternions.from_matrix(own))
        for path, values in {"translation": at, "rotation": wxyz[:, [1, 2, 3, 0]]}.items():
            sampler = g.AnimationSampler(input=times, output=buffer.add(values.astype(np.float32)))
            target = g.AnimationChannelTarget(node=first + k, path=path)
            animation.channels.append(g.AnimationChannel(sampler=len(animation.samplers), target=target))
            animation.samplers.append(sampler)
    return animation


def _turned(vectors: NDArray[np.float64]) -> NDArray[np.float32]:
    return y_up(np.asarray(vectors, np.float32))
