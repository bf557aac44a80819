"""Mesh files: what is read of each, and that what is damaged ends in one line."""

import io

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image

from cape.meshes.files.glb import read_glb
from cape.meshes.files.obj import read_obj
from cape.meshes.files.ply import read_ply
from cape.meshes.reading import read_cloth, read_source
from motions.errors import FileError, UserError, ValueRangeError
from tests.meshes.mesh_files import glb, obj, ply, sheet

POINTS, FACES = sheet(4, 5)
UV = np.random.default_rng(1).uniform(0.0, 1.0, (len(POINTS), 2))
TURNED = POINTS[:, [2, 0, 1]]  # a file's (x, y, z) with Y up and +Z ahead is (z, x, y) here

places = st.lists(
    st.tuples(*[st.floats(-1e3, 1e3, allow_subnormal=False)] * 3), min_size=3, max_size=12, unique=True
).map(np.array)


@settings(max_examples=40, deadline=None)
@given(places)
def test_an_objs_places_come_back_as_they_were_written(points):
    face = np.arange(len(points))[None]
    source = read_obj(obj(points, face).encode(), "own.obj")
    assert np.array_equal(source.positions, points[:, [2, 0, 1]])
    # A face of n corners is a fan of n - 2 triangles.
    assert len(source.triangles) == len(points) - 2
    assert set(source.triangles.ravel().tolist()) == set(range(len(points)))


def test_objects_and_groups_of_an_obj_are_maps():
    text = obj(POINTS, FACES[:1], before="o coat\ng collar left") + "g hem\nf -1 -2 -3\n"
    source = read_obj(text.encode(), "own.obj")
    of = {name: set(np.flatnonzero(values).tolist()) for name, values in source.weights.items()}
    first, last = set(source.triangles[0].tolist()), set(source.triangles[1].tolist())
    assert of == {"coat": first | last, "collar": first, "left": first, "hem": last}
    assert np.array_equal(source.positions[source.triangles[1]], TURNED[[-1, -2, -3]])


def test_a_vertex_of_an_obj_stands_once_for_each_of_its_texture_coordinates():
    text = "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0.25 1\nvt 0.5 0.5\nf 1/1 2/2 3/3\nf 1/4 2/2 3/3\n"
    source = read_obj(text.encode(), "own.obj")
    assert len(source.positions) == 4
    assert source.uv is not None
    # OBJ counts from the bottom left, textures from the top left.
    assert source.uv[source.triangles[0]].tolist() == [[0.0, 1.0], [1.0, 1.0], [0.25, 0.0]]
    assert source.uv[source.triangles[1, 0]].tolist() == [0.5, 0.5]


def test_z_up_faces_against_y():
    source = read_obj(
        obj(np.array([[1.0, 0, 0], [0, -1.0, 0], [0, 0, 1.0]]), np.array([[0, 1, 2]])).encode(), "a", up="z"
    )
    assert source.positions.tolist() == [[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]


def test_properties_of_a_plys_vertices_are_maps():
    pin, soft = np.arange(len(POINTS), dtype=np.uint8), np.linspace(0.0, 1.0, len(POINTS))
    source = read_ply(ply(POINTS, FACES, s=UV[:, 0], t=UV[:, 1], pin=pin, soft=soft).encode(), "own.ply")
    assert source.positions == pytest.approx(TURNED)
    assert np.array_equal(source.triangles, FACES)
    assert source.weights["pin"] == pytest.approx(pin / 255.0)
    assert source.weights["soft"] == pytest.approx(soft, abs=1e-6)
    assert source.uv == pytest.approx(np.stack([UV[:, 0], 1.0 - UV[:, 1]], axis=1), abs=1e-6)


def test_a_glbs_node_attributes_skin_and_texture_are_read():
    count = len(POINTS)
    joints = np.tile(np.array([[0, 1, 0, 0]], dtype=np.uint16), (count, 1))
    share = np.linspace(0.0, 1.0, count, dtype=np.float32)
    weights = np.stack([share, 1.0 - share, np.zeros(count), np.zeros(count)], axis=1)
    picture = np.arange(48, dtype=np.uint8).reshape(4, 4, 3)
    stream = io.BytesIO()
    Image.fromarray(picture).save(stream, format="PNG")
    own = {"TEXCOORD_0": UV, "_PIN": share, "JOINTS_0": joints, "WEIGHTS_0": weights}
    skinned = read_glb(
        glb(
            POINTS,
            FACES,
            own,
            node={"skin": 0, "translation": [9.0, 9.0, 9.0]},
            joints=("neck", "chest"),
            image=stream.getvalue(),
        ),
        "own.glb",
    )
    # A skin's mesh is where its joints are: the node does not move it.
    assert skinned.positions == pytest.approx(TURNED, abs=1e-6)
    assert set(skinned.weights) == {"coat", "PIN", "neck", "chest"}
    assert skinned.weights["neck"] == pytest.approx(share)
    assert skinned.weights["chest"] == pytest.approx(1.0 - share)
    assert skinned.uv == pytest.approx(UV, abs=1e-6)
    assert skinned.textures is not None
    assert np.array_equal(skinned.textures.albedo, picture)
    half = np.sqrt(0.5)
    turned = {"rotation": [0.0, 0.0, half, half], "scale": [2.0, 2.0, 2.0], "translation": [0.0, 0.0, 1.0]}
    moved = read_glb(glb(POINTS, FACES, node=turned), "own.glb")
    # A quarter turn about z takes x to y and y to -x.
    expected = 2.0 * np.stack([-POINTS[:, 1], POINTS[:, 0], POINTS[:, 2]], axis=1) + [0.0, 0.0, 1.0]
    assert moved.positions == pytest.approx(expected[:, [2, 0, 1]], abs=1e-6)


WHOLE = {
    ".obj": obj(POINTS, FACES, uv=UV).encode(),
    ".ply": ply(POINTS, FACES, pin=UV[:, 0]).encode(),
    ".glb": glb(POINTS, FACES, {"TEXCOORD_0": UV, "_PIN": UV[:, 0]}),
}


@pytest.mark.parametrize("suffix", WHOLE)
@settings(max_examples=40, deadline=None)
@given(data=st.data())
def test_damage_ends_in_a_mesh_or_in_one_line(suffix, data, tmp_path_factory):
    whole = bytearray(WHOLE[suffix])
    for _ in range(data.draw(st.integers(1, 4))):
        whole[data.draw(st.integers(0, len(whole) - 1))] = data.draw(st.integers(0, 255))
    cut = bytes(whole[: data.draw(st.integers(0, len(whole)))]) if data.draw(st.booleans()) else bytes(whole)
    path = tmp_path_factory.getbasetemp() / f"damaged{suffix}"
    path.write_bytes(cut)
    try:
        source = read_source(path)
    except FileError:
        return
    assert source.triangles.min() >= 0
    assert source.triangles.max() < len(source.positions)


@pytest.mark.parametrize(
    ("name", "text", "told"),
    [
        ("a.fbx", "", "available: .glb, .obj, .ply"),
        ("a.obj", "v 0 0 0\n", "has no face"),
        ("a.obj", "v 0 0 0\nf 1 2 3\n", "line 2: can't read 'f 1 2 3': there is no 2 among 1 vertices so far"),
        ("a.obj", "v 0 0 nought\n", "line 1"),
        ("a.ply", "ply\n", "no PLY that can be read"),
        ("a.glb", "glTF", "no GLB that can be read"),
    ],
)
def test_what_is_wrong_with_a_file_is_told(name, text, told, tmp_path):
    (tmp_path / name).write_text(text)
    with pytest.raises(FileError, match=None) as caught:
        read_cloth(tmp_path / name)
    assert told in str(caught.value)
    assert "\n" not in str(caught.value)


def test_options_out_of_range_are_told(tmp_path):
    path = tmp_path / "a.glb"
    path.write_bytes(WHOLE[".glb"])
    with pytest.raises(ValueRangeError, match="GLB has Y up, not z"):
        read_cloth(path, up="z")
    with pytest.raises(UserError, match="scale"):
        read_cloth(path, scale=0.0)
    with pytest.raises(ValueRangeError, match=r"m gives [0-9]+ vertices, more than"):
        read_cloth(path, spacing=1e-4)
    with pytest.raises(FileError):
        read_cloth(tmp_path / "none.obj")
