"""Characters from glTF files: their vertices are where a plain computation from matrices puts them."""

import json
from pathlib import Path

import numpy as np
import pygltflib as gl
import pytest

import motions
from motions.conventions import to_z_up
from motions.gltf.accessors import values_of
from motions.gltf.document import Document
from tests.characters.builder import Glb, body, character, skinned, walking

BODY = body()
SAME = 2e-6  # [m]: single precision of a file and of what is drawn, metres from the middle of the world


def drawn(clip: motions.Clip) -> np.ndarray:
    """All vertices of a clip's mesh in all frames [m], shape (F, V, 3)."""
    assert clip.skin is not None
    places, turns = clip.world_poses()
    at = [clip.index(bone) for bone in clip.skin.bones]
    posed = [clip.skin.posed(piece, places[:, at], turns[:, at], morphs=clip.morphs) for piece in clip.skin.pieces]
    return np.concatenate([np.stack([vertices for vertices, _ in frames]) for frames in posed], axis=1)


def expected(frames: int = 2, root: np.ndarray | None = None) -> np.ndarray:
    """Where the walking body's vertices are, Z up."""
    _, places, turns = walking(BODY, frames)
    return skinned(BODY, places, turns, root) @ to_z_up("y").T


def test_a_mesh_follows_its_joints(tmp_path):
    clip = motions.load(character(tmp_path / "hero.glb", BODY))
    assert (clip.name, clip.fps, clip.frames, clip.decisions) == ("hero", 60.0, 2, ())
    assert clip.joints[0] == "mixamorig:Hips"
    assert clip.skin is not None
    assert clip.skin.pieces[0].name == "Body"
    assert np.abs(drawn(clip) - expected()).max() < SAME
    # Z up: the head is above the feet, and the whole stands in the world of the file.
    assert clip.world_positions()[0, clip.index("mixamorig:Head"), 2] > 1.4


def test_a_root_that_turns_scales_and_moves_counts(tmp_path):
    turn = np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]])  # 90 degrees about Y
    root = np.eye(4)
    root[:3, :3], root[:3, 3] = turn, (1.0, 0.0, 2.0)
    own = {"rotation": [0.0, 0.5**0.5, 0.0, 0.5**0.5], "scale": [0.01] * 3, "translation": [1.0, 0.0, 2.0]}
    clip = motions.load(character(tmp_path / "hero.glb", BODY, root=own, unit=0.01))
    assert np.abs(drawn(clip) - expected(root=root)).max() < SAME
    matrix = 0.01 * turn
    flat = [*matrix[:, 0], 0.0, *matrix[:, 1], 0.0, *matrix[:, 2], 0.0, 1.0, 0.0, 2.0, 1.0]
    clip = motions.load(character(tmp_path / "matrix.glb", BODY, root={"matrix": flat}, unit=0.01))
    assert np.abs(drawn(clip) - expected(root=root)).max() < SAME


def test_scales_that_differ_by_axes_and_mirrors_are_left_to_the_mesh(tmp_path):
    squeezed = np.diag([-1.0, 0.9, 1.1, 1.0])
    clip = motions.load(character(tmp_path / "hero.glb", BODY, root={"scale": [-1.0, 0.9, 1.1]}))
    # In the first frame, whose shear is what the mesh keeps.
    assert np.abs(drawn(clip)[0] - expected(root=squeezed)[0]).max() < SAME
    # A mirror alone leaves joints rigid, in all frames.
    mirrored = motions.load(character(tmp_path / "mirrored.glb", BODY, frames=30, root={"scale": [-1.0, 1.0, 1.0]}))
    assert np.abs(drawn(mirrored) - expected(30, np.diag([-1.0, 1.0, 1.0, 1.0]))).max() < SAME
    # A mirror turns triangles inside out, unless they are turned back: the file's own volume is positive.
    assert clip.skin is not None
    piece, vertices = clip.skin.pieces[0], drawn(clip)[0]
    a, b, c = (vertices[piece.triangles[:, k]] for k in range(3))
    assert np.einsum("ti,ti->t", a, np.cross(b, c)).sum() > 0.0


@pytest.mark.parametrize(
    ("options", "tolerance"),
    [
        ({"interleaved": True}, SAME),
        ({"weights": "u2"}, 2e-5),
        ({"weights": "u1"}, 4e-3),
    ],
)
def test_weights_may_be_fractions_of_whole_numbers_and_vertices_interleaved(tmp_path, options, tolerance):
    clip = motions.load(character(tmp_path / "hero.glb", BODY, **options))
    assert np.abs(drawn(clip) - expected()).max() < tolerance


@pytest.mark.parametrize(
    ("kind", "numbers", "fractions"),
    [
        ("u1", [0, 51, 255], [0.0, 0.2, 1.0]),
        ("u2", [0, 13107, 65535], [0.0, 0.2, 1.0]),
        ("i2", [-32768, -32767, 32767], [-1.0, -1.0, 1.0]),
    ],
)
def test_whole_numbers_stand_for_fractions(kind, numbers, fractions):
    file = Glb()
    data = np.array(numbers, "<" + kind).tobytes()
    file.accessor(file.view(data), kind, 3, 1, normalized=True)
    document = Document("a.glb", json.loads(file.top.to_json()), file.blob)
    document.top["buffers"] = [{"byteLength": len(file.blob)}]
    assert values_of(document, 0).ravel().tolist() == fractions


@pytest.mark.parametrize("name", ["in_itself.gltf", "apart.gltf", "hero.vrm"])
def test_the_bytes_may_be_elsewhere(tmp_path, name):
    clip = motions.load(character(tmp_path / name, BODY))
    assert np.abs(drawn(clip) - expected()).max() < SAME


def two_bones(path: Path, *, rigid: bool = False, sparse: bool = False, second_skin: bool = False) -> Path:
    """An upper bone, and a lower one 1 m below it that is turned 90 degrees about Z, each with a triangle."""
    file = Glb()
    triangle = np.array([[0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [0.0, -0.2, 0.0]])
    nodes = [
        gl.Node(name="Upper", children=[1], translation=[0.0, 1.8, 0.0]),
        gl.Node(name="Lower", translation=[0.0, -1.0, 0.0], rotation=[0.0, 0.0, 0.5**0.5, 0.5**0.5]),
    ]
    if sparse:
        places = [file.put_sparse(triangle, None), file.put_sparse(triangle, 0.5 * triangle)]
    else:
        places = [file.put(triangle), file.put(triangle)]
    skins = 2 if second_skin else 1
    for number in range(2):
        own = {"POSITION": places[number]}
        if not rigid or number == 0:
            joint = 0 if second_skin else number
            own["JOINTS_0"] = file.put(np.tile([joint, 0, 0, 0], (3, 1)), "u1")
            own["WEIGHTS_0"] = file.put(np.tile([1.0, 0.0, 0.0, 0.0], (3, 1)))
        file.top.meshes.append(gl.Mesh(primitives=[gl.Primitive(attributes=gl.Attributes(**own))]))
        if rigid and number == 1:
            nodes[1].children = [3]
            nodes.append(gl.Node(name="Hat", mesh=1, translation=[0.1, 0.0, 0.0]))
        else:
            nodes.append(gl.Node(name=f"Mesh {number}", mesh=number, skin=number if second_skin else 0))
    file.top.nodes = nodes
    # Without inverse bind matrices a mesh is in the frames of its joints.
    file.top.skins = [gl.Skin(joints=[k] if second_skin else [0, 1]) for k in range(skins)]
    file.top.scenes[0].nodes = [0, 2] if rigid else [0, 2, 3]
    file.animate("Still", [(0, "translation", np.array([0.0, 0.1]), np.tile([0.0, 1.8, 0.0], (2, 1)), "LINEAR")])
    return file.write(path)


@pytest.mark.parametrize("how", [{}, {"sparse": True}, {"second_skin": True}])
def test_two_bones_by_hand(tmp_path, how):
    vertices = drawn(motions.load(two_bones(tmp_path / "a.glb", **how), unit="m"))[0]
    # Y up (x, y, z) is (x, -z, y) with Z up; the lower bone's X points up.
    assert np.allclose(vertices[:3], [[0.0, 0.0, 1.8], [0.2, 0.0, 1.8], [0.0, 0.0, 1.6]], atol=1e-6)
    assert np.allclose(vertices[3:], [[0.0, 0.0, 0.8], [0.0, 0.0, 1.0], [0.2, 0.0, 0.8]], atol=1e-6)


def test_what_hangs_at_a_joint_goes_along(tmp_path):
    clip = motions.load(two_bones(tmp_path / "a.glb", rigid=True), unit="m")
    assert clip.joints == ("Upper", "Lower")
    vertices = drawn(clip)[0]
    assert np.allclose(vertices[3:], [[0.0, 0.0, 0.9], [0.0, 0.0, 1.1], [0.2, 0.0, 0.9]], atol=1e-6)


def test_unit_height_and_axis_may_be_set(tmp_path):
    path = character(tmp_path / "hero.glb", BODY)
    clip = motions.load(path)
    as_told = motions.load(path, unit="cm")
    assert np.allclose(drawn(as_told), 0.01 * drawn(clip), atol=1e-6)
    taller = motions.load(path, height=1.9)
    assert taller.standing_height() == pytest.approx(1.9, abs=1e-4)  # by the few frames that it is measured in
    assert np.allclose(drawn(taller), drawn(clip) * 1.9 / clip.standing_height(), atol=2e-4)
    lying = motions.load(path, up="z")
    assert np.allclose(drawn(lying), expected() @ to_z_up("y"), atol=1e-5)


def test_centimetres_that_no_scale_makes_good_are_noticed(tmp_path):
    clip = motions.load(character(tmp_path / "hero.glb", BODY, unit=0.01))
    assert "unit: cm = 0.01 m" in clip.decisions[0]
    assert np.abs(drawn(clip) - expected()).max() < SAME


def test_a_clip_keeps_its_mesh_as_it_is_cut(tmp_path):
    clip = motions.load(character(tmp_path / "hero.glb", BODY, frames=4))
    assert np.allclose(drawn(clip.trim(2 / 60, 3 / 60)), expected(4)[2:], atol=SAME)


def test_material_and_texture_come_along(tmp_path):
    colour = gl.PbrMetallicRoughness(baseColorFactor=[0.5, 0.25, 0.125, 1.0])
    clip = motions.load(character(tmp_path / "hero.glb", BODY, material=gl.Material(pbrMetallicRoughness=colour)))
    assert clip.skin is not None
    piece = clip.skin.pieces[0]
    assert piece.rgba is not None
    assert np.allclose(piece.rgba, [0.5, 0.25, 0.125, 1.0])
    assert piece.image is None
