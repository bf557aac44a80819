"""Hitboxes of a character's own mesh: which bone has which part of it, and solids that hold these."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.distance import cdist
from scipy.spatial.transform import Rotation

import motions
import skeleton
from motions import quaternions
from motions.skin import SkinPiece
from skeleton import Capsule, Skeleton
from skeleton.robot.links import find_links
from skeleton.skinned.bind_pose import in_bind_pose
from skeleton.skinned.surfaces import bone_surfaces
from tests.characters.builder import body, character

BODY = body(fingers=True)


@pytest.fixture(scope="module")
def hero(tmp_path_factory) -> Skeleton:
    own = {"scale": [0.01] * 3}
    path = character(tmp_path_factory.mktemp("hero") / "hero.glb", BODY, unit=0.01, root=own)
    return Skeleton.from_clip(motions.load(path))


def test_each_bone_has_what_follows_it_most(hero):
    surfaces = {surface.bone: surface for surface in bone_surfaces(hero.skin, hero.bones)}
    assert set(surfaces) == {BODY.names[joint] for joint in BODY.joints[:, 0]}
    assert sum(len(surface.triangles) for surface in surfaces.values()) == len(BODY.triangles)
    # A forearm's tube is 5 cm thick, hardly longer than the forearm, and lies along it in the bone's own frame.
    forearm = surfaces["mixamorig:LeftForeArm"]
    length = 0.26
    middle = np.linalg.norm(forearm.vertices[:, 1:], axis=1)
    along = forearm.vertices[:, 0]
    assert middle.max() == pytest.approx(0.05, abs=2e-3)
    assert 0.9 * length < np.ptp(along) < 1.4 * length


def test_fingers_are_part_of_the_hand_and_bones_of_the_spine_are_not(hero):
    limbs = {link.name: link for link in find_links(hero, limbs_only=True).links}
    every = {link.name: link for link in find_links(hero).links}
    assert set(every) - set(limbs) == {
        name for name in every if (name[-1].isdigit() and "Hand" in name) or name.endswith("ToeBase")
    }
    assert len(every) - len(limbs) == 22
    assert {"mixamorig:Spine", "mixamorig:Spine1"} <= set(limbs)
    assert limbs["mixamorig:LeftHand"].role == "left_hand"
    # The hand with its fingers reaches from the wrist to their tips.
    assert limbs["mixamorig:LeftHand"].size > every["mixamorig:LeftHand"].size + 0.01
    area = sum(link.areas.sum() for link in every.values())
    assert sum(link.areas.sum() for link in limbs.values()) == pytest.approx(area, rel=1e-9)


def test_solids_hold_the_mesh_in_motion(hero, tmp_path):
    forearm = "mixamorig:LeftForeArm"
    only = replace(hero, skin=replace(hero.skin, pieces=(_part(hero, forearm),)))
    hitboxes = skeleton.hitboxes_of(only)
    (solid,) = hitboxes.solids
    assert isinstance(solid, Capsule)
    assert (solid.name, solid.bone) == ("left_forearm", forearm)
    assert solid.radius == pytest.approx(0.05, abs=2e-3)
    assert hitboxes.qualities[forearm].outside < 0.021
    assert hitboxes.qualities[forearm].volume_ratio < 1.25
    hitboxes.save(tmp_path / "hero.toml")
    assert skeleton.load_hitboxes(tmp_path / "hero.toml", hero).solids[0].bone == forearm
    kept = skeleton.kept_hitboxes_of(only, tmp_path / "kept")
    again = skeleton.kept_hitboxes_of(only, tmp_path / "kept")
    assert len(list((tmp_path / "kept").iterdir())) == 2
    assert kept.solids[0].describe() == again.solids[0].describe() == solid.describe()


def _part(hero: Skeleton, bone: str) -> SkinPiece:
    """The triangles of the mesh of which all corners follow a bone most."""
    assert hero.skin is not None
    piece = hero.skin.pieces[0]
    mine = np.array([hero.skin.bones[bind] == bone for bind in piece.dominant])
    return replace(piece, triangles=piece.triangles[mine[piece.triangles].all(axis=1)])


def test_a_body_without_mesh_has_capsules_by_proportions():
    body = Skeleton.from_clip(motions.load("walk").trim(0.0, 0.1))
    assert "by the proportions" in skeleton.hitboxes_of(body).decisions[0]


def test_hitboxes_go_where_the_mesh_goes(hero):
    """The bone's frame that surfaces and solids are in is the one of the track."""
    index = hero.bones.index("mixamorig:Head")
    surface = next(s for s in bone_surfaces(hero.skin, hero.bones) if s.bone == "mixamorig:Head")
    rest = hero.rest
    placed = rest.positions[index] + quaternions.rotate(rest.rotations_wxyz[index], surface.vertices)
    assert placed[:, 2].max() == pytest.approx(rest.positions[index, 2] + 0.17, abs=0.05)


def test_the_pose_that_the_mesh_was_bound_in_is_found_again(tmp_path):
    axes = Rotation.from_quat(np.random.default_rng(1).normal(size=(len(BODY.names), 4))).as_quat()
    clip = motions.load(character(tmp_path / "hero.glb", BODY, axes=axes, unit=0.01, root={"scale": [0.01] * 3}))
    who = Skeleton.from_clip(clip)
    assert who.skin is not None
    # Bent by hand, so that the mean over the motion is no T-pose.
    turned = who.rest.rotations_wxyz + np.random.default_rng(2).normal(scale=0.3, size=who.rest.rotations_wxyz.shape)
    bent = replace(who.rest, rotations_wxyz=quaternions.normalize(turned))
    bound = in_bind_pose(bent, who.skin)
    middles, expected = [], []
    for surface in bone_surfaces(who.skin, who.bones):
        index = who.bones.index(surface.bone)
        placed = bound.positions[index] + quaternions.rotate(bound.rotations_wxyz[index], surface.vertices)
        middles.append(placed.mean(axis=0))
        expected.append(BODY.vertices[BODY.joints[:, 0] == BODY.names.index(surface.bone)].mean(axis=0))
    np.testing.assert_allclose(cdist(middles, middles), cdist(expected, expected), atol=1e-5)
    assert np.allclose(bound.positions[0], 0.0)


def test_both_sides_get_alike_solids_of_meshes_that_are_nearly_alike(hero):
    right, left = _part(hero, "mixamorig:RightForeArm"), _part(hero, "mixamorig:LeftForeArm")
    uneven = 1.0 + 0.02 * np.random.default_rng(0).normal(size=right.vertices.shape)
    center = right.vertices[np.unique(right.triangles)].mean(axis=0)
    right = replace(right, vertices=center + uneven * (right.vertices - center))
    solids = skeleton.hitboxes_of(replace(hero, skin=replace(hero.skin, pieces=(left, right)))).solids
    assert {solid.name for solid in solids} == {"left_forearm", "right_forearm"}
    first, second = (float(np.linalg.norm(solid.end - solid.start)) for solid in solids if isinstance(solid, Capsule))
    assert first == pytest.approx(second, abs=1e-9)
