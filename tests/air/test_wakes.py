"""Wakes behind capsules against what a cylinder's drag takes from the wind."""

import numpy as np
import pytest

from cape import Box, Capsule, Plane, Pose
from cape.air.wakes import DRAG, Wakes, slowing

ALONG = np.array([1.0, 0.0, 0.0])
RADIUS = 0.1


def behind(x: float, y: np.ndarray) -> np.ndarray:
    """The slowing on a line across the wake of an upright cylinder, far from its ends."""
    places = np.stack([np.full_like(y, x), y, np.zeros_like(y)], axis=1)
    return slowing(places, np.array([0.0, 0.0, -5.0]), np.array([0.0, 0.0, 5.0]), RADIUS, ALONG)


@pytest.mark.parametrize("x", [1.0, 3.0, 10.0])
def test_a_wake_lacks_the_momentum_that_drag_has_taken(x: float):
    # To first order in u / U a wake's lost momentum is rho U times the integral of u, and the drag of a width d of
    # cylinder is rho / 2 c d U^2: the integral of u / U is c d / 2. Schlichting's 10 / 18 times 0.45 is half of it.
    y = np.linspace(-3.0, 3.0, 20001)
    assert np.trapezoid(behind(x, y), y) == pytest.approx(DRAG * 2.0 * RADIUS / 2.0, rel=1e-3)


def test_wakes_widen_and_fade_as_a_root():
    y = np.linspace(0.0, 3.0, 30001)
    near, far = behind(2.0, y), behind(8.0, y)
    assert far[0] == pytest.approx(near[0] / 2.0, rel=1e-9)
    assert y[far > 0.0].max() == pytest.approx(2.0 * y[near > 0.0].max(), rel=1e-3)


def test_right_behind_a_body_there_is_no_wind_and_before_it_all():
    y = np.array([0.0, 0.09, 0.11])
    np.testing.assert_array_equal(behind(0.02, y), [1.0, 1.0, 0.0])
    np.testing.assert_array_equal(behind(-0.5, y), 0.0)


def test_a_cape_behind_a_body_that_turns_away_gets_the_wind():
    limb = Capsule(
        name="trunk", bone="spine", start=np.array([0.0, 0.0, 0.0]), end=np.array([0.0, 0.0, 0.5]), radius=0.15
    )
    still = [limb, Plane(point=np.zeros(3), normal=np.array([0.0, 0.0, 1.0]))]
    wakes = Wakes(still, ["spine"])
    place = np.array([[0.3, 0.0, 1.2]])
    upright = Pose(np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]]), np.tile([1.0, 0.0, 0.0, 0.0], (2, 1)))
    assert wakes.left(place, np.array([4.0, 0.0, 0.0]), *upright)[0] < 0.2
    assert wakes.left(place, np.array([-4.0, 0.0, 0.0]), *upright)[0] == 1.0
    assert wakes.left(place, np.zeros(3), *upright)[0] == 1.0
    moved = Pose(upright.positions + np.array([[0.0, 5.0, 0.0], [0.0, 0.0, 0.0]]), upright.rotations_wxyz)
    assert wakes.left(place, np.array([4.0, 0.0, 0.0]), *moved)[0] == 1.0


def test_a_box_keeps_the_wind_off_as_a_ball_of_its_volume():
    box = Wakes([Box(center=np.zeros(3), half_sizes=np.full(3, 0.2))], [])
    world = Pose(np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]]))
    radius = 0.4 * (0.75 / np.pi) ** (1.0 / 3.0)
    places = np.array([[0.3, 0.99 * radius, 0.0], [0.01, 1.01 * radius, 0.0]])
    left = box.left(places, ALONG, *world)
    assert left[0] < 1.0
    assert left[1] == 1.0
