"""The stage of a recording: floor and background, the height that a view holds, and that a loop shows no seam."""

from dataclasses import replace

import numpy as np
import pytest

from cape.record.frames import Frames
from cape.record.stage import (
    BACKGROUND,
    DARK_BACKGROUND,
    TILE_COLORS,
    darkened_floor,
    figure_height,
    ground,
    skeleton_height,
    smoothed_path,
)
from cape.scene.colliders import Plane
from cape.scene.loops import Travel
from motions import quaternions
from skeleton.robot.meshes.link_surfaces import LinkSurface
from skeleton.track import BoneTrack


def light(srgb: np.ndarray) -> np.ndarray:
    """Light of sRGB values, both 0 to 1, by its exact gamma's usual approximation of 2.2 within 0.006."""
    return srgb**2.2


def test_the_darkened_floor_fades_into_the_dark_background():
    (drawn,) = darkened_floor()["/world/floor"]
    (packed,) = drawn.overrides[0].as_arrow_array().to_pylist()
    factor = np.array([(packed >> shift) & 255 for shift in (24, 16, 8)]) / 255.0
    assert packed & 255 == 255
    seen = light(np.array(BACKGROUND) / 255.0) * light(factor)
    np.testing.assert_allclose(seen, light(np.array(DARK_BACKGROUND) / 255.0), atol=0.006)
    # As numbers, without regard to light, they would be another colour.
    assert np.abs(np.array(BACKGROUND) * factor - DARK_BACKGROUND).max() > 2.0


def test_a_view_holds_the_head_and_the_feet_of_a_robot():
    turned = quaternions.from_z_axis(np.array([1.0, 0.0, 0.0]))  # the bone's Z lies along the world's X
    bones = BoneTrack(
        ("hips", "chest"),
        np.array([0.0, 0.1]),
        np.array([[[0.0, 0.0, 0.8], [0.0, 0.0, 1.1]]] * 2),
        np.array([[[1.0, 0.0, 0.0, 0.0], turned]] * 2),
        parents=np.array([-1, 0]),
    )
    frames = Frames(np.arange(2), bones.times)
    assert skeleton_height(bones, frames) == pytest.approx(0.3)
    assert figure_height(bones, frames) == pytest.approx(0.3)
    legs = LinkSurface("legs", "legs", "hips", np.array([[0.0, 0.0, -0.8], [0.1, 0.0, 0.0]]), np.zeros((0, 3), int))
    long = LinkSurface("long", "long", "chest", np.array([[0.0, 0.0, 9.0]]), np.zeros((0, 3), int))
    still = LinkSurface("still", "still", None, np.array([[0.0, 0.0, 50.0]]), np.zeros((0, 3), int))
    # From the soles at 0 to the chest's 1.1 m: what lies along X adds no height, nor what no bone carries.
    assert figure_height(bones, frames, [legs, long, still]) == pytest.approx(1.1)
    assert figure_height(bones, frames, [replace(legs, vertices=0.1 * legs.vertices), still]) == pytest.approx(0.3)


def turning(frames: int = 120) -> BoneTrack:
    """A pelvis that walks on a circle through the origin, half of it in so many frames, and sways once in 40."""
    share = np.arange(frames) / frames
    angles = np.pi * share
    aside = np.stack([-np.sin(angles), np.cos(angles)], axis=1)
    path = 2.0 * (np.array([0.0, 1.0]) - aside) + 0.05 * np.sin(2.0 * np.pi * 3.0 * share)[:, None] * aside
    turns = np.stack([np.cos(angles / 2.0), 0.0 * angles, 0.0 * angles, np.sin(angles / 2.0)], axis=1)
    positions = np.concatenate([path, np.ones((frames, 1))], axis=1)
    return BoneTrack(
        ("pelvis",), np.arange(frames) / 60.0, positions[:, None], turns[:, None], roles={"pelvis": "pelvis"}
    )


def test_the_camera_sees_no_seam_in_a_loop():
    bones = turning()
    frames, travel = Frames(np.arange(120), bones.times), Travel(np.pi, np.array([0.0, 4.0, 0.0]), 0.0, "pelvis")

    def jolts(path: np.ndarray) -> tuple[float, float]:
        """Largest third difference at the seams, and within a round [m]."""
        over = np.concatenate([travel.back(path), path, travel.forth(path)])
        sizes = np.linalg.norm(np.diff(over, n=3, axis=0), axis=1)
        return max(sizes[117:120].max(), sizes[237:240].max()), sizes[120:237].max()

    at_seams, within = jolts(smoothed_path(bones, frames, travel))
    assert at_seams < 1.01 * within
    at_seams, within = jolts(smoothed_path(bones, frames))
    assert at_seams > 2.0 * within


def test_the_ground_of_a_loop_looks_alike_after_a_round():
    period = np.array([3.0, 2.0, 0.0])
    plane = Plane(point=np.array([0.0, 0.0, 0.2]))
    vertices, _, colors = ground(np.array([[0.0, 0.0, 1.0], [9.0, 6.0, 1.0]]), plane, period)
    np.testing.assert_allclose(vertices[:, 2], 0.2, atol=1e-6)
    tiles = vertices.reshape(-1, 4, 3).mean(axis=1)[:, :2]
    lit = colors.reshape(-1, 4, 3)[:, 0].astype(int)
    near = np.flatnonzero(np.linalg.norm(tiles - [1.5, 1.0], axis=1) < 1.0)
    assert len(near) > 4
    pairs = [np.linalg.norm(tiles - (tiles[k] + period[:2]), axis=1) for k in near]
    assert max(pair.min() for pair in pairs) < 1e-5
    np.testing.assert_array_equal(lit[[pair.argmin() for pair in pairs]], lit[near])
    assert all((lit[near] == color).all(axis=1).any() for color in TILE_COLORS)
