"""A character's mesh in kept takes and exports: it is there, and moves with its bones."""

# USD's modules are compiled, and tell pyright little.
# pyright: reportAttributeAccessIssue=false, reportMissingModuleSource=false

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, UsdSkel

import cape
import motions
import skeleton
from cape.cli.exports.writing import write
from cape.record.figure.skin import morphs_of
from cape.results.take import Take
from motions.errors import FileError, ValueRangeError
from motions.skin import Skin
from tests.characters.builder import body, character, skinned, walking
from tests.characters.test_morphs import TIMES, by_lines, face
from tests.characters.test_reading import drawn
from tests.exports import skinned_reader
from tests.exports.a_figure import make_figure, picture, placed
from tests.exports.a_take import FPS, FRAMES, difference, make_take
from tests.exports.test_formats import GLB

CLOSE = 1e-5  # m
Z_UP_TO_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])


@pytest.fixture(scope="module")
def take() -> Take:
    return make_figure()


def skin_of(take: Take) -> Skin:
    assert take.bones.skin is not None
    return take.bones.skin


def same(a: object, b: object) -> None:
    np.testing.assert_allclose(np.asarray(a, float), np.asarray(b, float), rtol=0.0, atol=CLOSE)


def test_a_kept_take_keeps_the_mesh(take: Take, tmp_path: Path):
    take.keep(tmp_path / "a.npz")
    read = Take.load(tmp_path / "a.npz")
    assert difference(take, read) == ""
    assert skin_of(read).pieces[0].image == picture("PNG")


def broken(path: Path, where: str, value: object) -> None:
    """Give a field of a kept mesh another value: of its first piece, or of itself."""
    with np.load(path) as archive:
        arrays = dict(archive)
    content = json.loads(arrays["take"].item())
    bones = content["take"]["fields"]["bones"]["fields"]
    skin = bones["skin"]["fields"]
    (bones if where in ("skin", "morphs") else skin if where in skin else skin["pieces"]["tuple"][0]["fields"])[
        where
    ] = value
    np.savez(path, allow_pickle=False, **(arrays | {"take": np.array(json.dumps(content).encode())}))


@pytest.mark.parametrize(
    ("where", "value", "told"),
    [
        ("skin", {"numbers": [1], "of": "<i8"}, "skin must be a Skin or None"),
        ("skin", {"is": "Gone", "fields": {}}, "no class named 'Gone'"),
        ("morphs", {"numbers": [[0.0, 1.0]], "of": "<f8"}, r"morphs must be finite numbers of the shape \(7, 3\)"),
        ("morphs", None, ""),
        ("bones", {"tuple": ["hip", "tail", "hip", "hip", "hip"]}, "hangs at 'tail', which isn't among"),
        ("bones", {"tuple": ["hip"]}, r"binds must be numbers of the shape \(1, 3, 4\)"),
        ("pieces", {"tuple": [3]}, "pieces must be a sequence, each a SkinPiece"),
        ("binds", {"array": "take.triangles"}, "binds must be numbers of the shape"),
        ("triangles", {"numbers": [[0, 1, 7]], "of": "<i8"}, "a vertex that is not among the 7"),
        ("weights", {"array": "take.bones.skin.pieces.0.vertices"}, "weights must be numbers"),
        ("vertices", {"array": "gone"}, "gone"),
        ("image", "a text", "the image of 'coat/outer' is a str"),
        ("name", 5, "a piece of the skin"),
    ],
)  # fmt: skip
def test_a_kept_mesh_that_makes_no_sense_ends_in_a_line(where, value, told, take: Take, tmp_path: Path):
    take.keep(tmp_path / "a.npz")
    broken(tmp_path / "a.npz", where, value)
    if not told:
        assert Take.load(tmp_path / "a.npz").bones.morphs is None
        return
    with pytest.raises(FileError, match=f"holds no take that this version of cape .* can read: .*{told}"):
        Take.load(tmp_path / "a.npz")


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        ({"binds": np.full((7, 6), 5)}, "hangs at a binding that is not among 5"),
        ({"vertices": np.full((7, 3), np.nan)}, "isn't finite"),
        ({"binds": np.zeros((7, 6))}, "binds must be numbers"),
        ({"targets": np.zeros((0, 7, 3))}, "morph targets come with the morphs"),
        ({"targets": np.zeros((2, 7, 3)), "target_morphs": np.array([0])}, r"targets must be numbers of the shape \(1"),
        ({"targets": np.zeros((0, 7, 3)), "target_morphs": np.zeros(0, int)}, "must be None where there are none"),
        ({"triangles": np.zeros((0, 3), int)}, "has no triangle"),
        ({"vertices": "all"}, "vertices must be an array of numbers"),
    ],
)  # fmt: skip
def test_a_mesh_that_does_not_fit_is_refused(changes, told, take: Take):
    skin = skin_of(take)
    with pytest.raises(ValueRangeError, match=told):
        replace(skin, pieces=(replace(skin.pieces[0], **changes),))


def test_a_mesh_may_be_told_by_lists(take: Take):
    coat = skin_of(take).pieces[0]
    told = replace(coat, vertices=coat.vertices.tolist(), triangles=coat.triangles.tolist(), binds=coat.binds.tolist())
    assert difference(coat, told) == ""


def test_a_skin_has_a_mesh(take: Take):
    with pytest.raises(ValueRangeError, match="at least one piece"):
        replace(skin_of(take), pieces=())


@pytest.mark.parametrize("kept", [np.s_[:2], np.s_[:, :2]], ids=["frames", "morphs"])
def test_weights_of_too_few_frames_or_morphs_are_refused(take: Take, kept):
    skin, bones = skin_of(take), take.bones
    at = [bones.index(bone) for bone in skin.bones]
    assert bones.morphs is not None
    poses = skin.posed(skin.pieces[1], bones.positions[:, at], bones.rotations_wxyz[:, at], morphs=bones.morphs[kept])
    with pytest.raises(ValueRangeError, match=r"morphs must be finite numbers of the shape \(7, 3\)"):
        next(poses)


def test_a_glb_shows_the_mesh_where_its_bones_take_it(take: Take, tmp_path: Path):
    take.export(tmp_path / "a.glb")
    content = GLB(tmp_path / "a.glb").content
    for piece in skin_of(take).pieces:
        [node] = [k for k, each in enumerate(content["nodes"]) if each["name"] == piece.name]
        read = skinned_reader.read(tmp_path / "a.glb", node)
        same(read.times, np.arange(FRAMES) / FPS)
        same(read.vertices, placed(take.bones, piece) @ Z_UP_TO_Y_UP.T)
        same(read.weights.sum(axis=1), 1.0)
        [primitive] = content["meshes"][content["nodes"][node]["mesh"]]["primitives"]
        assert np.array_equal(GLB(tmp_path / "a.glb").array(primitive["indices"]).reshape(-1, 3), piece.triangles)
        assert node in content["scenes"][0]["nodes"]
    [coat] = [each for each in content["materials"] if each["name"] == "coat/outer"]
    assert coat["pbrMetallicRoughness"]["baseColorFactor"] == [0.5, 0.25, 1.0, 0.75]
    image = content["images"][content["textures"][coat["pbrMetallicRoughness"]["baseColorTexture"]["index"]]["source"]]
    assert image["mimeType"] == "image/png"
    assert GLB(tmp_path / "a.glb").view(image["bufferView"]) == picture("PNG")
    joints = [joint for each in content["skins"] for joint in each["joints"]]
    assert len(set(joints)) == len(joints) == 5  # of a skin each counts once


def test_a_glb_of_joint_chains_has_the_mesh_as_well(take: Take, tmp_path: Path):
    with pytest.warns(UserWarning, match="4 joints put the cloth"):
        take.export(tmp_path / "a.glb", joints=4)
    nodes = GLB(tmp_path / "a.glb").content["nodes"]
    [node] = [k for k, each in enumerate(nodes) if each["name"] == "face"]
    read, piece = skinned_reader.read(tmp_path / "a.glb", node), skin_of(take).pieces[1]
    assert read.vertices.shape == (FRAMES, len(piece.vertices), 3)
    assert "cape" in {each["name"] for each in nodes}
    same(read.vertices, placed(take.bones, piece) @ Z_UP_TO_Y_UP.T)


def test_usd_shows_the_mesh_where_its_bones_take_it(take: Take, tmp_path: Path):
    names = [file.name for file in take.export(tmp_path / "a.usd")]
    assert names == ["a.usd", "a_albedo.png", "a_coat_outer.png"]
    assert (tmp_path / "a_coat_outer.png").read_bytes() == picture("PNG")
    stage = Usd.Stage.Open(str(tmp_path / "a.usd"))
    assert UsdSkel.BakeSkinning(UsdSkel.Root(stage.GetPrimAtPath("/take/figure")), Gf.Interval(0.0, FRAMES - 1.0))
    for name, piece in zip(("coat_outer", "face"), skin_of(take).pieces, strict=True):
        mesh, expected = UsdGeom.Mesh(stage.GetPrimAtPath(f"/take/figure/{name}")), placed(take.bones, piece)
        for frame in range(FRAMES):
            same(mesh.GetPointsAttr().Get(frame), expected[frame])
        assert np.array_equal(np.reshape(mesh.GetFaceVertexIndicesAttr().Get(), (-1, 3)), piece.triangles)
        material, _ = UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()
        assert material.GetPath() == f"/take/figure/{name}/material"
    texture = UsdShade.Shader(stage.GetPrimAtPath("/take/figure/coat_outer/material/albedo"))
    assert isinstance(texture.GetInput("file").Get(), Sdf.AssetPath)
    assert Path(texture.GetInput("file").Get().resolvedPath).name == "a_coat_outer.png"


def test_a_piece_of_any_name_leaves_the_cloths_picture_alone(take: Take, tmp_path: Path):
    skin = skin_of(take)
    named = replace(skin, pieces=tuple(replace(piece, name="albedo") for piece in skin.pieces))
    files = replace(take, bones=replace(take.bones, skin=named)).export(tmp_path / "a.usda")
    assert [file.name for file in files] == ["a.usda", "a_albedo.png", "a_albedo_2.png"]
    assert files[1].read_bytes() != picture("PNG") == files[2].read_bytes()


def test_a_recording_moves_a_skin_by_its_own_morphs_alone(take: Take):
    skin = skin_of(take)
    again = replace(skin, pieces=tuple(replace(piece) for piece in skin.pieces))
    assert morphs_of(take.bones, again) is take.bones.morphs
    other = replace(skin, pieces=(skin.pieces[0], replace(skin.pieces[1], target_morphs=np.array([0, 2]))))
    assert other.morphs == skin.morphs
    assert morphs_of(take.bones, other) is None


def test_single_frames_and_meshes_without_morphs_told(tmp_path: Path):
    take = make_figure(1)
    plain = replace(take, bones=replace(take.bones, morphs=None))
    for file in ("a.glb", "a.usd"):
        assert plain.export(tmp_path / file)[0].stat().st_size > 0
    content = GLB(tmp_path / "a.glb").content
    assert [each.get("weights") for each in content["meshes"] if each["name"] == "face"] == [[0.0, 0.0]]


def test_what_is_written_brings_a_character_along_that_the_bones_do_not_tell(take: Take, tmp_path: Path):
    write(make_take(), tmp_path / "a.npz", skin=skin_of(take))
    assert difference(skin_of(take), skin_of(Take.load(tmp_path / "a.npz"))) == ""


def take_of(clip: motions.Clip) -> Take:
    """A take of a small cloth that stays where it is, while a character moves."""
    track = skeleton.Skeleton.from_clip(clip).track(clip)
    assert track.skin is clip.skin
    cloth = cape.Cloth.rectangle(width=0.2, height=0.2, spacing=0.1)
    still = np.repeat(cloth.positions[None].astype(np.float32), clip.frames, axis=0)
    zero, none = np.zeros(clip.frames), np.full(clip.frames, -1)
    return Take(
        "walk", track, (), cloth.triangles, cloth.texcoords, still, zero, 0.0, zero, none, zero, "", 1, 0.0, 0.0, 0.0
    )


def test_a_character_from_a_file_goes_into_files(tmp_path: Path):
    who = body()
    clip = motions.load(character(tmp_path / "hero.glb", who, frames=4))
    take_of(clip).keep(tmp_path / "walk.npz")
    Take.load(tmp_path / "walk.npz").export(tmp_path / "out.glb")
    _, places, turns = walking(who, 4)
    nodes = GLB(tmp_path / "out.glb").content["nodes"]
    [node] = [k for k, each in enumerate(nodes) if each["name"] == "Body"]
    read, expected = skinned_reader.read(tmp_path / "out.glb", node).vertices, skinned(who, places, turns)
    assert read.shape == expected.shape == (4, len(who.vertices), 3)
    assert np.ptp(expected, axis=0).max() > 0.01  # it moves
    same(read, expected)


def test_a_character_comes_back_from_a_glb(tmp_path: Path):
    clip = motions.load(face(tmp_path / "a.glb", weights=(TIMES, by_lines(TIMES), "LINEAR")), unit="m")
    take_of(clip).export(tmp_path / "out.glb")
    again = motions.load(tmp_path / "out.glb", unit="m")
    assert "left out: the mesh 'cape', which no joint carries" in again.decisions
    assert again.frames == clip.frames
    assert np.ptp(drawn(clip), axis=0).max() > 0.3
    same(drawn(again), drawn(clip))


def test_bones_that_lack_one_of_a_mesh_drop_it(take: Take):
    assert take.bones.select(["hip", "left arm"]).skin is None
    whole = take.bones.select(["left:hand", "hip", "left arm"])
    assert whole.skin is take.bones.skin
    assert whole.morphs is not None
    assert take.bones.morphs is not None
    assert np.array_equal(whole.morphs, take.bones.morphs)


@pytest.mark.extra
def test_pixars_validators_find_nothing(take: Take, tmp_path: Path):
    from pxr import UsdValidation

    take.export(tmp_path / "a.usd")
    registry = UsdValidation.ValidationRegistry()
    stage = Usd.Stage.Open(str(tmp_path / "a.usd"))
    found = UsdValidation.ValidationContext(registry.GetOrLoadAllValidators()).Validate(stage)
    assert [(error.GetName(), error.GetMessage()) for error in found] == []
