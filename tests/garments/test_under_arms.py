"""Arms that pass through the body: how deep, by closed forms on a figure; and garments that are worn under them."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import cape
import motions
from motions import quaternions
from skeleton import BoneTrack, Capsule, Skeleton
from skeleton.checks.arms import forearm_sides, passages
from skeleton.shapes import Box, Sphere
from tests.support.figures import figure

# Of the figure: the left wrist is 9 cm outwards of the hip joint and 5 cm below it.
APART = float(np.hypot(0.09, 0.05))
FIST = Sphere(name="fist", bone="LeftHand", center=np.zeros(3), radius=0.06)
HIP = Sphere(name="hip", bone="LeftUpLeg", center=np.zeros(3), radius=0.08)


@pytest.fixture(scope="module")
def body() -> Skeleton:
    return Skeleton.from_clip(figure(frames=3))


@pytest.fixture(scope="module")
def still(body) -> BoneTrack:
    return body.track(figure(frames=3))


def lifted(track: BoneTrack, bone: str, frame: int, aside: float) -> BoneTrack:
    """The track with a bone farther to the left from a frame on [m]."""
    positions = track.positions.copy()
    positions[frame:, track.index(bone), 0] += aside
    return replace(track, positions=positions)


def test_the_depth_is_how_far_one_reaches_into_the_other(body, still):
    (found,) = passages(body, still, [FIST, HIP]).items()
    assert found[0] == "fist"
    assert found[1].through == "hip"
    assert found[1].depth == pytest.approx(0.06 + 0.08 - APART, abs=1e-9)
    assert passages(body, still, [replace(FIST, radius=APART - 0.081), HIP]) == {}


def test_it_is_told_where_it_is_deepest(body, still):
    moving = lifted(lifted(still, "LeftHand", 0, 0.02), "LeftHand", 2, -0.01)
    pelvis = Sphere(name="far", bone="Hips", center=np.zeros(3), radius=0.01)
    (passage,) = passages(body, moving, [pelvis, FIST, HIP]).values()
    assert (passage.through, passage.frame) == ("hip", 2)
    assert passage.depth == pytest.approx(0.14 - np.hypot(0.10, 0.05), abs=1e-9)


def test_a_limb_is_looked_at_all_along_its_middle(body, still):
    # From the elbow down beside the thigh, which it is in by its far end alone.
    forearm = Capsule("forearm", "LeftForeArm", np.zeros(3), down(still, "LeftForeArm", "LeftUpLeg"), 0.05)
    (passage,) = passages(body, still, [forearm, HIP]).values()
    assert passage.depth == pytest.approx(0.05 + 0.08, abs=1e-9)


def test_a_box_is_looked_at_all_over(body, still):
    box = Box(name="fist", bone="LeftHand", center=np.zeros(3), half_sizes=np.full(3, 0.06))
    (passage,) = passages(body, still, [box, HIP]).values()
    # Its middle alone reaches as far as a ball in it does; the whole, no farther than its corners do.
    assert 0.14 - APART - 1e-9 <= passage.depth <= 0.08 - APART + 0.06 * np.sqrt(3.0)


def test_upper_arms_and_the_other_arm_are_let_be(body, still):
    shoulder = Sphere(name="shoulder", bone="LeftArm", center=np.zeros(3), radius=0.3)
    chest = Sphere(name="chest", bone="Chest", center=np.zeros(3), radius=0.3)
    assert passages(body, still, [shoulder, chest]) == {}
    other = Sphere(name="other", bone="RightHand", center=np.zeros(3), radius=0.5)
    assert set(passages(body, still, [FIST, other])) == set()
    assert set(passages(body, still, [FIST, other, HIP])) == {"fist", "other"}


def test_solids_that_are_not_the_body_s_are_let_be(body, still):
    wall = Sphere(name="wall", center=np.array([0.0, 0.18, 0.9]), radius=0.5)
    assert passages(body, still, [FIST, wall]) == {}


def test_an_arm_is_of_its_side_from_the_elbow_on(body):
    sides = dict(zip(body.bones, forearm_sides(body), strict=True))
    assert {bone for bone, side in sides.items() if side == "left"} == {"LeftForeArm", "LeftHand"}
    assert {bone for bone, side in sides.items() if side == "right"} == {"RightForeArm", "RightHand"}


def down(track: BoneTrack, bone: str, to: str) -> np.ndarray:
    """Where a bone is in the frame of another, at the start."""
    at, there = track.index(bone), track.index(to)
    back = quaternions.conjugate(track.rotations_wxyz[0, at])
    return quaternions.rotate(back, track.positions[0, there] - track.positions[0, at])


@pytest.fixture(scope="module")
def walker() -> tuple[Skeleton, BoneTrack]:
    clip = motions.load("walk")
    body = Skeleton.from_clip(clip)
    return body, body.track(clip)


def with_a_club(body: Skeleton, track: BoneTrack) -> tuple[cape.Collider, ...]:
    """The body's capsules, and in its left hand a ball that is in its thigh as the motion begins."""
    thigh, hand = (track.positions[0, track.index(role)] for role in ("left_thigh", "left_hand"))
    club = cape.Sphere(name="club", bone="left_hand", center=np.zeros(3), radius=float(np.linalg.norm(thigh - hand)))
    return (*body.capsules(), club)


ROUGHLY: dict[str, Any] = {"garment": "skirt", "spacing": 0.05}
OVER: list[dict[str, Any]] = [{"garment": "shoulder_cape"}, {"garments": ["back_cape", "skirt"]}]


def test_arms_that_pass_through_the_body_are_let_through_what_is_worn_under_them(walker):
    body, track = walker
    colliders = with_a_club(body, track)
    deepest = passages(body, track, colliders)
    scene = cape.dress(body, track, colliders=colliders, **ROUGHLY)
    # The hand's own capsule hangs from the same wrist; the other arm, and this one's forearm, are where they belong.
    assert set(scene.left_out) == {"club", "left_hand"}
    assert {c.name for c in colliders} - {c.name for c in scene.colliders} == {"club", "left_hand"}
    depth, through, frame = deepest["club"]
    assert scene.left_out["club"].startswith(f"{1000 * depth:.0f} mm deep in {through} at frame {frame}")
    take = cape.simulate(scene, track.first(2), settle=0.0)
    assert {"club", "left_hand"} <= set(take.left_out)


def test_they_push_what_is_worn_over_them(walker):
    body, track = walker
    colliders = with_a_club(body, track)
    for worn in OVER:
        scene = cape.dress(body, track, colliders=colliders, spacing=0.05, **worn)
        assert not scene.left_out
        assert {c.name for c in colliders} < {c.name for c in scene.colliders}


def test_an_arm_in_the_body_by_less_than_the_cloth_is_thick_counts(walker):
    body, track = walker
    scene = cape.dress(body, track, **ROUGHLY)
    assert not scene.left_out
    thigh = next(c for c in body.capsules() if c.name == "left_thigh")

    def fist(radius: float) -> list[Capsule | cape.Sphere]:
        return [thigh, cape.Sphere(name="fist", bone="left_hand", center=np.zeros(3), radius=radius)]

    touching = 1.0 - passages(body, track, fist(1.0))["fist"].depth
    for share, left_out in ((0.9, False), (1.1, True)):
        colliders = [*body.capsules(), fist(touching + share * scene.thickness)[1]]
        assert ("fist" in cape.dress(body, track, colliders=colliders, **ROUGHLY).left_out) == left_out
