"""Morph targets: vertices are moved by them before bones do, by weights that are closed forms of the time."""

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pygltflib as gl
import pytest
import rerun as rr

import motions
from cape import record
from motions.conventions import to_z_up
from motions.errors import FileError
from motions.skin import SkinPiece
from skeleton import Skeleton
from tests.characters.builder import Glb
from tests.characters.test_reading import drawn

FPS, FRAMES = 20.0, 9
TIMES = np.arange(FRAMES) / FPS
KEYS = np.array([0.0, 0.1, 0.25, 0.4])
SAME = 2e-6  # [m]: single precision of a file and of what is drawn

REST = np.array([[0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [0.0, 0.0, -0.3], [0.1, 0.2, 0.1]])
MOVES = np.array([
    [[0.0, 0.0, 0.0], [0.1, 0.2, -0.1], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]],
    [[0.0, 0.3, 0.0], [0.0, 0.0, 0.0], [0.1, 0.1, 0.2], [0.0, -0.1, 0.0]],
    [[0.2, 0.0, 0.0], [0.2, 0.0, 0.0], [0.2, 0.0, 0.0], [0.2, 0.0, 0.0]],
])  # fmt: skip
NORMALS = np.tile([0.0, 1.0, 0.0], (4, 1))
BENDS = np.array([np.tile([1.0, 0.0, 0.0], (4, 1)), np.tile([0.0, 0.0, 1.0], (4, 1)), np.zeros((4, 3))])
TRIANGLES = np.array([[0, 1, 2], [1, 3, 2]])
TURNED = [0.0, 0.0, 0.5**0.5, 0.5**0.5]  # x, y, z, w: 90 degrees about Z

Channel = tuple[np.ndarray, np.ndarray, str]


def face(
    path: Path,
    *,
    weights: Channel | None = None,
    bones: bool = True,
    mesh_weights: list[float] | None = None,
    sparse: bool = False,
    normals: bool = False,
    fixed: bool = False,
    moves: np.ndarray = MOVES,
) -> Path:
    """A body of two bones, the upper one of which walks along X, and on the lower one, 1 m below, a mesh with targets.

    Args:
        path: the file.
        weights: key times, values and interpolation of what an animation makes of the targets.
        bones: whether the animation moves the upper bone as well.
        mesh_weights: that the mesh states.
        sparse: whether targets are sparse accessors.
        normals: whether there are normals, that the first two targets bend.
        fixed: whether the mesh hangs at the bone, without a skin.
        moves: of the targets.
    """
    file = Glb()
    own = {"POSITION": file.put(REST)} | ({"NORMAL": file.put(NORMALS)} if normals else {})
    targets = [{"POSITION": file.put_sparse(each, None) if sparse else file.put(each)} for each in moves]
    for target, bend in zip(targets[:2], BENDS, strict=False) if normals else ():
        target["NORMAL"] = file.put(bend)
    if not fixed:
        own["JOINTS_0"] = file.put(np.tile([1, 0, 0, 0], (4, 1)), "u1")
        own["WEIGHTS_0"] = file.put(np.tile([1.0, 0.0, 0.0, 0.0], (4, 1)))
    primitive = gl.Primitive(attributes=gl.Attributes(**own), indices=file.put(TRIANGLES.reshape(-1, 1), "u4"))
    primitive.targets = targets  # pyright: ignore[reportAttributeAccessIssue]
    body = gl.Primitive(attributes=gl.Attributes(**(own | {"POSITION": file.put(REST + 1.0)})))
    body.attributes.JOINTS_0 = file.put(np.tile([0, 0, 0, 0], (4, 1)), "u1")
    body.attributes.WEIGHTS_0 = file.put(np.tile([1.0, 0.0, 0.0, 0.0], (4, 1)))
    body.indices = primitive.indices
    file.top.meshes = [gl.Mesh(name="Face", primitives=[primitive], weights=mesh_weights),
                       gl.Mesh(name="Body", primitives=[body])]  # fmt: skip
    file.top.nodes = [
        gl.Node(name="Upper", children=[1], translation=[0.0, 1.8, 0.0]),
        gl.Node(name="Lower", translation=[0.0, -1.0, 0.0], rotation=TURNED, children=[2] if fixed else []),
        gl.Node(name="Face", mesh=0, skin=None if fixed else 0),
        gl.Node(name="Body", mesh=1, skin=0),
    ]
    file.top.skins = [gl.Skin(joints=[0, 1])]
    file.top.scenes[0].nodes = [0, 3] if fixed else [0, 2, 3]
    channels: list[tuple[int, str, np.ndarray, np.ndarray, str]] = []
    if bones:
        walk = np.stack([TIMES, np.full(FRAMES, 1.8), 0.0 * TIMES], axis=1)
        channels.append((0, "translation", TIMES, walk, "LINEAR"))
    if weights is not None:
        times, values, way = weights
        channels.append((2, "weights", times, values.reshape(-1, 1), way))
    if channels:
        file.animate("Talk", channels)
    return file.write(path)


def expected(weights: np.ndarray, *, walking: bool = True) -> np.ndarray:
    """Where the face's vertices are for weights (F, 3), Z up: turned by 90 degrees about Z, then lifted and carried."""
    shapes = REST + np.einsum("fk,kvi->fvi", weights, MOVES)
    turned = np.stack([-shapes[..., 1], shapes[..., 0], shapes[..., 2]], axis=-1) + np.array([0.0, 0.8, 0.0])
    if walking:
        turned[..., 0] += TIMES[: len(weights), None]
    return turned @ to_z_up("y").T


def face_of(clip: motions.Clip) -> SkinPiece:
    assert clip.skin is not None
    return next(piece for piece in clip.skin.pieces if piece.name == "Face")


def of_face(clip: motions.Clip) -> np.ndarray:
    """The face's vertices in all frames [m], shape (F, 4, 3)."""
    return drawn(clip)[:, :4]


def by_steps(times: np.ndarray) -> np.ndarray:
    values = np.array([[0.0, 1.0, 0.5], [1.0, 0.2, 0.5], [-0.5, 0.0, 0.1], [0.3, 0.3, 0.3]])
    return values[np.searchsorted(KEYS, times + 1e-9, "right") - 1]


def by_lines(times: np.ndarray) -> np.ndarray:
    values = by_steps(KEYS)
    return np.stack([np.interp(times, KEYS, column) for column in values.T], axis=1)


def cubic(times: np.ndarray, derivative: int = 0) -> np.ndarray:
    powers = [np.polynomial.Polynomial([0.1, 2.0, -3.0, 4.0]), np.polynomial.Polynomial([1.0, -1.0, 0.0, 2.0]),
              np.polynomial.Polynomial([0.0, 0.0, 5.0])]  # fmt: skip
    return np.stack([each.deriv(derivative)(times) if derivative else each(times) for each in powers], axis=1)


WAYS: Mapping[str, tuple[Callable[[np.ndarray], np.ndarray], np.ndarray]] = {
    "STEP": (by_steps, by_steps(KEYS)),
    "LINEAR": (by_lines, by_steps(KEYS)),
    # A cubic is its own Hermite spline: tangent in, value and tangent out of each key.
    "CUBICSPLINE": (cubic, np.stack([cubic(KEYS, 1), cubic(KEYS), cubic(KEYS, 1)], axis=1)),
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("how", [{}, {"sparse": True}, {"fixed": True}, {"mesh_weights": [0.5, 0.0, -1.0]}])
def test_vertices_go_where_weights_and_then_bones_take_them(tmp_path, way: str, how: dict[str, Any]):
    weights, values = WAYS[way]
    clip = motions.load(face(tmp_path / "a.glb", weights=(KEYS, values, way), **how), unit="m")
    assert (clip.frames, clip.fps) == (FRAMES, FPS)
    assert np.abs(of_face(clip) - expected(weights(TIMES))).max() < SAME
    # The other mesh has no targets, and is where its bone takes it.
    assert np.abs(drawn(clip)[0, 4:] - (REST + np.array([1.0, 2.8, 1.0])) @ to_z_up("y").T).max() < SAME


def test_stated_weights_hold_where_nothing_moves_them(tmp_path):
    stated = np.array([0.5, 0.0, -1.0])
    clip = motions.load(face(tmp_path / "mesh.glb", mesh_weights=stated.tolist()), unit="m")
    assert np.abs(of_face(clip) - expected(np.tile(stated, (FRAMES, 1)))).max() < SAME
    assert clip.morphs is None
    assert face_of(clip).targets is None
    path = face(tmp_path / "node.gltf", mesh_weights=[1.0, 1.0, 1.0])
    text = json.loads(path.read_text())
    text["nodes"][2]["weights"] = stated.tolist()  # which goes before the mesh's own
    path.write_text(json.dumps(text))
    of_node = motions.load(path, unit="m")
    assert np.allclose(face_of(of_node).vertices, face_of(clip).vertices)


def test_targets_that_stay_as_stated_are_not_carried_along(tmp_path):
    values = np.tile([0.0, 0.0, 0.25], (len(KEYS), 1))
    values[:, 1] = KEYS
    path = face(tmp_path / "a.glb", weights=(KEYS, values, "LINEAR"), mesh_weights=[0.0, 0.0, 0.25])
    clip = motions.load(path, unit="m")
    assert clip.morphs is not None
    assert clip.morphs.shape == (FRAMES, 1)
    piece = face_of(clip)
    assert piece.targets is not None
    assert np.allclose(piece.targets, MOVES[1:2])


def test_a_face_moves_while_the_body_stands(tmp_path):
    clip = motions.load(face(tmp_path / "a.glb", weights=(TIMES, by_lines(TIMES), "LINEAR"), bones=False), unit="m")
    assert (clip.frames, clip.fps) == (FRAMES, FPS)
    assert np.abs(of_face(clip) - expected(by_lines(TIMES), walking=False)).max() < SAME


def test_what_no_joint_carries_does_not_tell_how_long_a_motion_is(tmp_path):
    path = face(tmp_path / "a.gltf", weights=(10.0 * KEYS, by_steps(KEYS), "LINEAR"))
    assert motions.load(path, unit="m").frames > 10 * (FRAMES - 1)
    text = json.loads(path.read_text())
    del text["nodes"][2]["skin"]
    path.write_text(json.dumps(text))
    clip = motions.load(path, unit="m")
    assert any("which no joint carries" in each for each in clip.decisions)
    assert (clip.frames, clip.fps, clip.morphs) == (FRAMES, FPS, None)


def test_normals_are_bent_and_stay_of_unit_length(tmp_path):
    clip = motions.load(face(tmp_path / "a.glb", weights=(KEYS, by_steps(KEYS), "LINEAR"), normals=True), unit="m")
    assert clip.skin is not None
    places, turns = clip.world_poses()
    at = [clip.index(bone) for bone in clip.skin.bones]
    poses = clip.skin.posed(face_of(clip), places[:, at], turns[:, at], morphs=clip.morphs)
    bent = NORMALS + np.einsum("fk,kvi->fvi", by_lines(TIMES), BENDS)
    bent /= np.linalg.norm(bent, axis=2, keepdims=True)
    turned = np.stack([-bent[..., 1], bent[..., 0], bent[..., 2]], axis=-1) @ to_z_up("y").T
    assert np.abs(np.array([normals for _, normals in poses]) - turned).max() < SAME


def test_weights_go_with_the_frames_of_clips_and_tracks(tmp_path):
    clip = motions.load(face(tmp_path / "a.glb", weights=(TIMES, by_lines(TIMES), "LINEAR")), unit="m")
    assert np.abs(of_face(clip.trim(0.1, 0.3)) - expected(by_lines(TIMES))[2:7]).max() < SAME
    fine = np.arange(2 * FRAMES - 1) / (2 * FPS)
    between = np.stack([np.interp(fine, TIMES, column) for column in by_lines(TIMES).T], axis=1)
    resampled = clip.resample(2 * FPS)
    assert resampled.morphs is not None
    assert np.allclose(resampled.morphs, between, atol=1e-6)
    track = Skeleton.from_clip(clip).track(clip)
    assert track.morphs is not None
    assert np.array_equal(track.part(2, 5).morphs, track.morphs[2:5])  # pyright: ignore[reportArgumentType]
    finer = track.resample(2 * FPS).morphs
    assert finer is not None
    assert np.allclose(finer, between, atol=1e-6)


def test_a_recording_draws_them(tmp_path):
    clip = motions.load(face(tmp_path / "a.glb", weights=(KEYS, by_steps(KEYS), "STEP")), unit="m")
    track = Skeleton.from_clip(clip).track(clip)
    record.save_hitboxes(track, [], tmp_path / "a.rrd")
    found = []
    for chunk in rr.chunk.RrdReader(tmp_path / "a.rrd").stream().filter(content="/world/body/Face"):
        batch = chunk.to_record_batch()
        if "Mesh3D:vertex_positions" in batch.schema.names:
            found += [row.as_py() for row in batch.column("Mesh3D:vertex_positions")]
    assert np.abs(np.array(found) - expected(by_steps(TIMES))).max() < SAME


@pytest.mark.parametrize(
    ("how", "told"),
    [
        ({"moves": MOVES[:, :3]}, "a morph target moves 3 vertices of 4"),
        (
            {"weights": (KEYS, by_steps(KEYS)[:, :2], "LINEAR")},
            "keyframes of node 2 have 4 times for 8 values of LINEAR",
        ),
        ({"weights": (KEYS, by_steps(KEYS), "CUBICSPLINE")}, "have 4 times for 12 values of CUBICSPLINE"),
        ({"mesh_weights": [1e30, 0.0, 0.0]}, "weights of morph targets hold a number that isn't finite, or beyond"),
        ({"mesh_weights": ["much"]}, "is no glTF that can be read"),
    ],
)
def test_damage_ends_in_a_line(tmp_path, how: dict[str, Any], told: str):
    asked: dict[str, Any] = {"weights": (KEYS, by_steps(KEYS), "LINEAR")} | how
    with pytest.raises(FileError, match=told):
        motions.load(face(tmp_path / "a.glb", **asked))
