"""The stage of a recording: floor and background, the height that a view holds, the trim of a cape."""

from dataclasses import replace

import numpy as np
import pytest

from cape.record.frames import Frames
from cape.record.stage import BACKGROUND, DARK_BACKGROUND, darkened_floor, figure_height, skeleton_height
from cape.record.surfaces.textures import HEM_COLOR, woven
from motions import quaternions
from skeleton.robot.link_surfaces import LinkSurface
from skeleton.track import BoneTrack

NARROWEST = 15  # texels of a line that stays whole at a quarter of its width, in a view of 900 pixels


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


def test_the_trim_has_no_line_that_breaks_into_dashes():
    texture = woven((190, 22, 48)).astype(int)
    golden = np.abs(texture[256] - HEM_COLOR).sum(axis=1) < 6
    edges = np.flatnonzero(np.diff(np.concatenate([[0], golden, [0]])))
    widths = edges[1::2] - edges[::2]
    assert len(widths) == 2
    assert widths.min() >= NARROWEST
