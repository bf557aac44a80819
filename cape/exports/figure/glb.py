"""A character in a binary glTF: its bones as nodes that move, and each piece of its mesh as a skin on them.

Bones keep their own frames, below a still node that turns the world from Z up to Y up. After the glTF 2.0 specification
(Khronos, 2021): 3.7.2.2 morph targets, 3.7.3 skins, 3.9 materials, 3.11 animations.
"""

# pygltflib states that texts and numbers may be left out, which its types don't.
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cape.exports.figure.joints import Joints, joints_of
from cape.exports.figure.looks import colour_of, image_of, normals_of
from cape.exports.gltf_parts import Buffer, summing_to_one
from cape.exports.moving_mesh import MovingMesh
from motions.skin import Skin, SkinPiece

TO_Y_UP = [-(0.5**0.5), 0.0, 0.0, 0.5**0.5]  # x, y, z, w: (x, y, z) to (x, z, -y), as `y_up` turns vectors
SET = 4  # influences of an attribute


def add_figure(gltf: Any, mesh: MovingMesh, buffer: Buffer) -> None:
    """Add the character of a take to a file that holds its cloth; nothing where it has no mesh."""
    import pygltflib as g

    skin = mesh.bones.skin
    if skin is None:
        return
    joints, root = joints_of(mesh.bones, skin), len(gltf.nodes)
    first, scene = root + 1, gltf.scenes[0]

    def below(joint: int) -> list[int]:
        return (first + np.flatnonzero(joints.parents == joint)).tolist()

    turns = joints.rotations_wxyz[..., [1, 2, 3, 0]].astype(np.float32)
    places = joints.positions.astype(np.float32)
    gltf.nodes.append(g.Node(name="figure", rotation=TO_Y_UP, children=below(-1)))
    gltf.nodes += [
        g.Node(name=name, translation=places[0, k].tolist(), rotation=turns[0, k].tolist(), children=below(k))
        for k, name in enumerate(joints.names)
    ]
    scene.nodes.append(root)
    gltf.skins.append(_skin(skin, joints, buffer, first))
    moves = [(first + k, path, each[:, k]) for k in range(len(joints.names)) for path, each in
             {"translation": places, "rotation": turns}.items()]  # fmt: skip
    for piece in skin.pieces:
        node, weights = len(gltf.nodes), _weights(piece, mesh)
        gltf.meshes.append(g.Mesh(name=piece.name, primitives=[_primitive(gltf, piece, buffer)]))
        gltf.nodes.append(g.Node(name=piece.name, mesh=len(gltf.meshes) - 1, skin=len(gltf.skins) - 1))
        scene.nodes.append(node)
        if weights is not None:
            gltf.meshes[-1].weights = weights[0].tolist()
            moves.append((node, "weights", weights.ravel()))
    if len(mesh.times) > 1:
        _animate(gltf.animations[0], moves, buffer)


def _animate(animation: Any, moves: list[tuple[int, str, NDArray[np.float32]]], buffer: Buffer) -> None:
    """Add linear keyframes at the times that the animation has already."""
    import pygltflib as g

    times = animation.samplers[0].input
    for node, path, values in moves:
        target = g.AnimationChannelTarget(node=node, path=path)
        animation.channels.append(g.AnimationChannel(sampler=len(animation.samplers), target=target))
        animation.samplers.append(g.AnimationSampler(input=times, output=buffer.add(values)))


def _skin(skin: Skin, joints: Joints, buffer: Buffer, first: int) -> Any:
    import pygltflib as g

    matrices = np.tile(np.eye(4, dtype=np.float32), (len(skin.binds), 1, 1))
    matrices[:, :3] = skin.binds
    at = (first + joints.of_bindings).tolist()
    return g.Skin(inverseBindMatrices=buffer.add(matrices), joints=at, skeleton=first - 1)


def _primitive(gltf: Any, piece: SkinPiece, buffer: Buffer) -> Any:
    import pygltflib as g

    attributes = {
        "POSITION": buffer.add(piece.vertices.astype(np.float32), bounded=True),
        "NORMAL": buffer.add(normals_of(piece)),
    }
    if piece.texcoords is not None:
        attributes["TEXCOORD_0"] = buffer.add(piece.texcoords.astype(np.float32))
    spare = ((0, 0), (0, -piece.binds.shape[1] % SET))
    weights = np.pad(summing_to_one(piece.weights), spare)
    binds = np.where(weights > 0.0, np.pad(piece.binds, spare), 0)
    kind = np.uint8 if binds.max(initial=0) < 256 else np.uint16
    for number in range(weights.shape[1] // SET):
        own = slice(SET * number, SET * (number + 1))
        attributes[f"JOINTS_{number}"] = buffer.add(binds[:, own].astype(kind))
        attributes[f"WEIGHTS_{number}"] = buffer.add(weights[:, own])
    corners = buffer.add(piece.triangles.ravel().astype(np.uint32))
    primitive = g.Primitive(attributes=g.Attributes(**attributes), indices=corners, material=len(gltf.materials))
    gltf.materials.append(_material(gltf, piece, buffer))
    if piece.targets is not None:
        primitive.targets = [
            {"POSITION": buffer.add(moved, bounded=True)}
            | (
                {}
                if piece.normal_targets is None
                else {"NORMAL": buffer.add(piece.normal_targets[k].astype(np.float32))}
            )
            for k, moved in enumerate(piece.targets.astype(np.float32))
        ]
    return primitive


def _weights(piece: SkinPiece, mesh: MovingMesh) -> NDArray[np.float32] | None:
    """Weights of a piece's K targets, shape (F, K); None where it has none."""
    if piece.target_morphs is None:
        return None
    if mesh.bones.morphs is None:
        return np.zeros((len(mesh.times), len(piece.target_morphs)), np.float32)
    return mesh.bones.morphs[:, piece.target_morphs].astype(np.float32)


def _material(gltf: Any, piece: SkinPiece, buffer: Buffer) -> Any:
    import pygltflib as g

    colour, image = colour_of(piece), image_of(piece)
    surface = g.PbrMetallicRoughness(baseColorFactor=list(colour), metallicFactor=0.0)
    if image is not None:
        gltf.images.append(g.Image(bufferView=buffer.view(image[0]), mimeType=f"image/{image[1]}"))
        gltf.samplers.append(g.Sampler(magFilter=g.LINEAR, minFilter=g.LINEAR_MIPMAP_LINEAR))
        gltf.textures.append(g.Texture(sampler=len(gltf.samplers) - 1, source=len(gltf.images) - 1))
        surface.baseColorTexture = g.TextureInfo(index=len(gltf.textures) - 1)
    mode = g.BLEND if colour[3] < 1.0 else g.OPAQUE
    return g.Material(name=piece.name, pbrMetallicRoughness=surface, doubleSided=True, alphaMode=mode, alphaCutoff=None)
