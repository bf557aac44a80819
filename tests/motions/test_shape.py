"""Who is who by the shape of a body, against the names of bodies that have them."""

from dataclasses import replace

import numpy as np
import pytest

import motions
from motions import quaternions
from motions.bodies.roles import ROLES, SIDES, find_roles
from motions.bodies.shape import find_shape, roles_by_shape, segments_of
from motions.clip import Clip

LIMBS = [f"{side}_{limb}" for side in SIDES for limb in ("upper_arm", "forearm", "hand", "thigh", "shin", "foot")]


def by_shape(clip: Clip) -> dict[str, str]:
    points = clip.sampled().world_points()
    found = roles_by_shape([*clip.parents.tolist(), *clip.end_parents.tolist()], len(clip.joints), points)
    return {role: clip.joints[joint] for role, joint in found.items()}


def mirrored(clip: Clip) -> Clip:
    """The clip as seen in a mirror across x: a reflection of the bones and of each turn."""
    flip = np.array([-1.0, 1.0, 1.0])
    return replace(
        clip,
        offsets=clip.offsets * flip,
        end_offsets=clip.end_offsets * flip,
        root_positions=clip.root_positions * flip,
        rotations_wxyz=clip.rotations_wxyz * [1.0, 1.0, -1.0, -1.0],
        local_positions=None if clip.local_positions is None else clip.local_positions * flip,
    )


@pytest.mark.parametrize("name", motions.clip_names())
def test_shapes_tell_what_names_do(name):
    clip = motions.load(name)
    named = find_roles(clip.joints, clip.parents.tolist())
    shaped = by_shape(clip)
    assert {role: shaped.get(role) for role in ROLES} == {role: named.get(role) for role in ROLES}


@pytest.mark.parametrize("name", motions.clip_names())
def test_in_a_mirror_left_is_right(name):
    clip = motions.load(name)
    shaped, other = by_shape(clip), by_shape(mirrored(clip))
    left, right = SIDES
    words = {role: role.replace(left, "?").replace(right, left).replace("?", right) for role in shaped}
    assert other == {words[role]: joint for role, joint in shaped.items()}


def test_real_bodies_are_told_by_shape_as_by_name(mocap):
    for path in sorted(mocap.glob("*.bvh")):
        clip = motions.load(path)
        named = find_roles(clip.joints, clip.parents.tolist())
        shaped = by_shape(clip)
        assert {role: shaped.get(role) for role in LIMBS} == {role: named[role] for role in LIMBS}, path.name


@pytest.mark.parametrize("turn", [0.0, 1.0, 2.5])
def test_the_way_a_body_looks_does_not_matter(turn):
    clip = motions.load("idle")
    about = quaternions.from_euler([turn], "z")
    turned = clip.rotations_wxyz.copy()
    turned[:, 0] = quaternions.multiply(about, turned[:, 0])
    assert by_shape(replace(clip, rotations_wxyz=turned)) == by_shape(clip)


def test_a_limb_has_two_halves_whatever_is_before_and_behind():
    points = np.cumsum([0.0, 0.1, 0.3, 0.28, 0.08, 0.05])[None, :, None] * np.array([1.0, 0.0, 0.0])
    assert segments_of(points, range(6)) == (1, 2, 3)
    assert segments_of(points[:, 3:], range(3)) == (0, 1, 2)
    assert segments_of(points, range(2)) is None
    rod = np.array([0.0, 1.0, 1.05, 1.1])[None, :, None] * np.array([1.0, 0.0, 0.0])
    assert segments_of(rod, range(4)) is None


def test_what_has_no_two_pairs_of_limbs_has_no_shape():
    assert find_shape([-1, 0, 1], np.zeros((1, 3, 3))) is None
    assert roles_by_shape([-1, 0, 0], 3, np.array([[[0.0, 0, 0], [1, 0, 0], [-1, 0, 0]]])) == {}
