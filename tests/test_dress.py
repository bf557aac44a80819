"""A character's own cape, and the floor under its motion."""

from dataclasses import replace

import numpy as np
import pytest

import cape
import motions
from cape.ground import floor_under
from motions.errors import UnknownNameError
from skeleton import BoneTrack, Capsule, Skeleton


def track_of(heights: np.ndarray) -> BoneTrack:
    """One upright bone at the given heights [m]."""
    positions = np.zeros((len(heights), 1, 3))
    positions[:, 0, 2] = heights
    rotations = np.zeros((len(heights), 1, 4))
    rotations[..., 0] = 1.0
    return BoneTrack(("foot",), np.arange(len(heights)) / 60.0, positions, rotations)


def test_the_floor_lies_under_the_lowest_capsule_but_for_rare_frames():
    heights = np.full(100, 0.5)
    heights[10] = -3.0
    capsule = Capsule("foot", "foot", np.array([0.0, 0.0, 0.1]), np.array([0.0, 0.0, -0.2]), 0.05)
    # 0.5 m up, 0.2 m down to the lower end, 0.05 m of radius; one frame of a hundred is rarer than 2 %.
    assert floor_under([capsule], track_of(heights)).point == pytest.approx([0.0, 0.0, 0.25], abs=1e-12)


def test_a_floor_without_a_body_is_at_zero():
    assert floor_under([cape.Sphere(radius=1.0)], track_of(np.full(3, 5.0))).point[2] == 0.0


@pytest.fixture(scope="module")
def walker():
    clip = motions.load("walk")
    body = Skeleton.from_clip(clip)
    return body, body.track(clip)


def test_a_cape_comes_with_the_floor_under_the_motion(walker):
    body, track = walker
    (floor,) = (c for c in cape.dress(body, track).colliders if isinstance(c, cape.Plane))
    # The clip's own floor is at 0; at most the whole thickness of a foot's capsule may reach below the soles.
    foot = next(c for c in body.capsules() if c.name == "left_foot")
    assert -2.0 * foot.radius < floor.point[2] < 0.0


def test_a_cape_follows_the_bodys_measures(walker):
    body, track = walker
    clip = motions.load("walk", height=0.5 * body.height())
    small = Skeleton.from_clip(clip)
    big_cloth, small_cloth = cape.dress(body, track).cloth, cape.dress(small, small.track(clip)).cloth
    assert small_cloth.vertices == big_cloth.vertices
    np.testing.assert_allclose(2.0 * small_cloth.pattern, big_cloth.pattern, rtol=0.01, atol=1e-3)


def test_a_motion_without_shoulders_is_refused_by_name(walker):
    body, track = walker
    without = replace(track, roles={r: b for r, b in track.roles.items() if r != "left_shoulder"})
    with pytest.raises(UnknownNameError, match="left_shoulder"):
        cape.dress(body, without)
