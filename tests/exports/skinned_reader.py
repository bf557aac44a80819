"""A reader of skinned GLB files on its own: what a viewer does, after the glTF specification (3.7.3)."""

# pygltflib states that everything may be left out.
# pyright: reportOptionalMemberAccess=false, reportOptionalIterable=false, reportOperatorIssue=false
# pyright: reportArgumentType=false, reportCallIssue=false, reportOptionalSubscript=false

from pathlib import Path
from typing import NamedTuple

import numpy as np
import pygltflib
from numpy.typing import NDArray

FORMS = {5126: "<f4", 5125: "<u4", 5123: "<u2", 5121: "<u1"}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
Array = NDArray[np.float64]


class Skinned(NamedTuple):
    """What a file shows: times (F,) [s], vertices (F, V, 3) [m, Y up], weights (V, n), parents of the joints (K,)."""

    times: Array
    vertices: Array
    weights: Array
    parents: list[int | None]


def read(path: Path, mesh: int = 0) -> Skinned:
    """Read a file in which some node is a skinned mesh, and play its one animation frame by frame."""
    gltf = pygltflib.GLTF2().load(str(path))
    assert gltf is not None
    blob = gltf.binary_blob()

    def array(index: int) -> NDArray:
        accessor = gltf.accessors[index]
        view = gltf.bufferViews[accessor.bufferView]
        flat = np.frombuffer(
            blob, FORMS[accessor.componentType], accessor.count * WIDTHS[accessor.type], view.byteOffset or 0
        )
        return flat.reshape(accessor.count, -1)

    animation, skin = gltf.animations[0], gltf.skins[gltf.nodes[mesh].skin]
    moves = {
        (channel.target.node, channel.target.path): array(animation.samplers[channel.sampler].output).astype(float)
        for channel in animation.channels
    }
    times = array(animation.samplers[0].input)[:, 0].astype(float)
    above = {child: node for node, each in enumerate(gltf.nodes) for child in each.children or []}

    def world(node: int, frame: int) -> Array:
        own = gltf.nodes[node]
        local = np.eye(4)
        if (turn := moves.get((node, "rotation"))) is not None:
            local[:3, :3] = rotation(turn[frame])
        elif own.rotation is not None:
            local[:3, :3] = rotation(np.array(own.rotation))
        place = moves.get((node, "translation"))
        local[:3, 3] = place[frame] if place is not None else own.translation or (0.0, 0.0, 0.0)
        return world(above[node], frame) @ local if node in above else local

    inverse = array(skin.inverseBindMatrices).reshape(-1, 4, 4).transpose(0, 2, 1)
    primitive = gltf.meshes[gltf.nodes[mesh].mesh].primitives[0]
    rest = np.pad(array(primitive.attributes.POSITION), ((0, 0), (0, 1)), constant_values=1.0).astype(float)
    sets = [k for k in range(4) if getattr(primitive.attributes, f"JOINTS_{k}", None) is not None]
    joints, weights = (
        np.concatenate([array(getattr(primitive.attributes, f"{name}_{k}")) for k in sets], axis=1)
        for name in ("JOINTS", "WEIGHTS")
    )
    targets = [np.pad(array(target["POSITION"]), ((0, 0), (0, 1))) for target in primitive.targets or []]
    frames = []
    for frame in range(len(times)):
        matrices = np.stack([world(node, frame) for node in skin.joints]) @ inverse
        blended = np.einsum("vs,vsij->vij", weights, matrices[joints])
        shares = moves[(mesh, "weights")].reshape(len(times), -1)[frame] if targets else []
        shape = rest + sum(share * target for share, target in zip(shares, targets, strict=True))
        frames.append(np.einsum("vij,vj->vi", blended, shape)[:, :3])
    parents = [skin.joints.index(above[j]) if above[j] in skin.joints else None for j in skin.joints]
    return Skinned(times, np.stack(frames), weights.astype(float), parents)


def rotation(quaternion: Array) -> Array:
    """The matrix of a unit quaternion x, y, z, w."""
    x, y, z, w = quaternion
    assert abs(np.linalg.norm(quaternion) - 1.0) < 1e-6
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
