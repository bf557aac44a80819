"""A take whose bones move a mesh, and where its vertices are by a plain computation of its own."""

import io
from dataclasses import replace

import numpy as np
from PIL import Image

from cape.results.take import Take
from motions.skin import Skin, SkinPiece
from skeleton.track import BoneTrack
from tests.exports.a_take import FRAMES, make_take


def picture(kind: str) -> bytes:
    """A small image, encoded."""
    file = io.BytesIO()
    Image.fromarray(np.arange(48, dtype=np.uint8).reshape(4, 4, 3)).save(file, kind)
    return file.getvalue()


def make_figure(frames: int = FRAMES) -> Take:
    """The take of `make_take` on bones that move a mesh.

    One piece has six influences, a material and a texture, the other two morph targets; two bindings share a bone, one
    of them in centimetres, and one flattens what hangs at it.
    """
    rng, take = np.random.default_rng(8), make_take(frames)
    binds = rng.normal(size=(5, 3, 4)) * 0.3 + np.pad(np.eye(3), ((0, 0), (0, 1)))
    binds[3] *= 0.01
    binds[4, :, 2] = 0.0
    bones = ("hip", "left arm", "left:hand", "hip", "left arm")
    corners = np.array([[0, 1, 2], [2, 1, 3], [3, 4, 5], [5, 4, 6]])
    shares = rng.random((7, 6)) * (rng.random((7, 6)) > 0.3) + 0.01
    coat = SkinPiece(
        name="coat/outer",
        vertices=rng.normal(size=(7, 3)),
        normals=None,
        triangles=corners,
        binds=rng.integers(0, 5, (7, 6)),
        weights=shares / shares.sum(axis=1, keepdims=True),
        texcoords=rng.random((7, 2)),
        rgba=np.array([0.5, 0.25, 1.0, 0.75]),
        image=picture("PNG"),
    )
    normals = rng.normal(size=(7, 3))
    face = SkinPiece(
        name="face",
        vertices=rng.normal(size=(7, 3)),
        normals=normals / np.linalg.norm(normals, axis=1, keepdims=True),
        triangles=corners,
        binds=rng.integers(0, 5, (7, 1)),
        weights=np.ones((7, 1)),
        targets=rng.normal(size=(2, 7, 3)),
        normal_targets=0.1 * rng.normal(size=(2, 7, 3)),
        target_morphs=np.array([2, 0]),
    )
    skin = Skin(bones, binds, (coat, face))
    return replace(take, bones=replace(take.bones, skin=skin, morphs=rng.random((frames, 3))))


def placed(bones: BoneTrack, piece: SkinPiece) -> np.ndarray:
    """Where a piece's vertices are [m], Z up, vertex by vertex, shape (F, V, 3)."""
    skin = bones.skin
    assert skin is not None
    found = np.zeros((bones.frames, len(piece.vertices), 3))
    for frame in range(bones.frames):
        for vertex, place in enumerate(piece.vertices):
            shape = place.copy()
            if piece.targets is not None and bones.morphs is not None:
                assert piece.target_morphs is not None
                for number, morph in enumerate(piece.target_morphs):
                    shape += bones.morphs[frame, morph] * piece.targets[number, vertex]
            for bind, weight in zip(piece.binds[vertex], piece.weights[vertex], strict=True):
                bone = bones.index(skin.bones[bind])
                w, x, y, z = bones.rotations_wxyz[frame, bone]
                at_bone = skin.binds[bind] @ [*shape, 1.0]
                axis = np.array([x, y, z])
                turned = at_bone + 2.0 * np.cross(axis, np.cross(axis, at_bone) + w * at_bone)
                found[frame, vertex] += weight * (bones.positions[frame, bone] + turned)
    return found
