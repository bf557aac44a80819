"""What the shipped clips are made with: curves, inverse kinematics of a leg, a foot that rolls, the centre of mass."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from motions import quaternions
from motions.clip import Clip
from motions.curves import bridged, keyed, periodic, quintic, step
from motions.making.body import (
    ANKLE_HEIGHT,
    BALL,
    END_OFFSETS,
    END_PARENTS,
    HEEL,
    HEIGHT,
    JOINTS,
    OFFSETS,
    PARENTS,
    SHIN,
    THIGH,
    Arm,
    center_of_mass,
)
from motions.making.figure import Upper, balanced, on_ground, spot, turned
from motions.making.legs import LONGEST_REACH, foot_rotation, reach, standing_ankle

FloatArray = NDArray[np.float64]

DOWN = np.array([0.0, 0.0, -1.0])
numbers = st.floats(-5.0, 5.0)


def standing(frames: int = 1) -> Clip:
    """The body in its rest pose, the hips at the origin."""
    still = np.tile([1.0, 0.0, 0.0, 0.0], (frames, len(JOINTS), 1))
    return Clip("rest", JOINTS, PARENTS, OFFSETS, END_PARENTS, END_OFFSETS, 60.0, np.zeros((frames, 3)), still)


def test_step_starts_and_ends_at_rest() -> None:
    h = 1e-4
    x = np.array([2.0 - h, 2.0, 2.0 + h, 2.5, 3.0 - h, 3.0, 3.0 + h])
    y = step(x, 2.0, 3.0)
    assert y[[0, 1, 3, 5, 6]] == pytest.approx([0, 0, 0.5, 1, 1])
    # The first term of the series is 10 s^3.
    assert y[2] == pytest.approx(10 * h**3, rel=1e-2)
    assert 1 - y[4] == pytest.approx(10 * h**3, rel=1e-2)


@given(st.tuples(*[numbers] * 6))
def test_quintic_reproduces_a_polynomial_of_its_degree(coefficients: tuple[float, ...]) -> None:
    polynomial = np.polynomial.Polynomial(coefficients)
    ends = [tuple(polynomial.deriv(k)(x) if k else polynomial(x) for k in range(3)) for x in (-0.5, 1.0)]
    x = np.linspace(-0.5, 1.0, 9)
    assert quintic(x, -0.5, 1.0, *ends) == pytest.approx(polynomial(x), abs=1e-10)


@given(st.lists(numbers, min_size=2, max_size=7), st.data())
def test_keyed_passes_its_keys_and_never_beyond(values: list[float], data: st.DataObject) -> None:
    gaps = data.draw(st.lists(st.floats(0.05, 2.0), min_size=len(values), max_size=len(values)))
    at = np.cumsum(gaps)
    keys = list(zip(at.tolist(), values, strict=True))
    assert keyed(at, *keys) == pytest.approx(values, abs=1e-9)
    for left, right, low, high in zip(at[:-1], at[1:], values[:-1], values[1:], strict=True):
        between = keyed(np.linspace(left, right, 21), *keys)
        assert between.min() >= min(low, high) - 1e-9
        assert between.max() <= max(low, high) + 1e-9
        assert np.all(np.diff(between) * np.sign(high - low) >= -1e-9)
    assert keyed([at[0] - 1, at[-1] + 1], *keys) == pytest.approx([values[0], values[-1]])


def test_periodic_keeps_the_harmonics_it_was_asked_for() -> None:
    def wave(phase: FloatArray, harmonics: int) -> FloatArray:
        turns = 2 * np.pi * phase
        return 3 + 2 * np.cos(turns) + 0.5 * np.sin(2 * turns) + (np.cos(5 * turns - 1) if harmonics >= 5 else 0)

    samples = wave(np.arange(25) / 25, 5)
    phase = np.linspace(-1, 2, 50)
    assert periodic(phase, samples, 5) == pytest.approx(wave(phase, 5), abs=1e-12)
    assert periodic(phase, samples, 4) == pytest.approx(wave(phase, 4), abs=1e-12)


def test_bridged_joins_without_a_jump_in_value_or_slope() -> None:
    x = np.linspace(0, 3, 3001)
    grounded, free = 0.2 + 0.1 * x, np.sin(4 * x)
    joined = bridged(x, grounded, free, leave=1.0, land=2.0, fade=0.3, slope_fade=0.2)
    outside = (x <= 1.0) | (x >= 2.0)
    assert joined[outside] == pytest.approx(grounded[outside], abs=1e-14)
    middle = (x > 1.31) & (x < 1.69)
    assert joined[middle] == pytest.approx(free[middle])
    slope = np.diff(joined) / np.diff(x)
    # Slopes change by the second derivative, at most 16 of the sine, 6 / 0.3^2 of the faded value of 1 and about
    # 30 / 0.2 of the faded slope of 2 to 3; a jump would be seen as a change of 0.5 or more between two samples.
    assert np.abs(np.diff(slope)).max() < 400 * (x[1] - x[0])


@given(
    st.floats(0.05, 0.999), st.floats(-1.4, 1.4), st.floats(-0.8, 0.8), st.floats(-0.6, 0.6), st.tuples(*[numbers] * 3)
)
def test_a_leg_reaches_the_ankle(share: float, swing: float, aside: float, hinge_yaw: float, hip: tuple) -> None:
    direction = quaternions.rotate(quaternions.from_euler([swing, aside], "yx"), DOWN)
    hips = np.array([hip])
    ankle = hips + share * LONGEST_REACH * direction
    hinge = np.array([[-np.sin(hinge_yaw), np.cos(hinge_yaw), 0.0]])
    thigh, shin = reach(hips, ankle, hinge)
    knee = hips + THIGH * quaternions.rotate(thigh, DOWN)
    assert knee + SHIN * quaternions.rotate(shin, DOWN) == pytest.approx(ankle, abs=1e-9)
    # The knee is in front of the line from hip to ankle, never behind.
    front = np.cross(hinge[0], -direction)
    assert np.dot((knee - hips)[0], front) >= -1e-9


def test_a_leg_stretches_towards_an_ankle_out_of_reach() -> None:
    hip, hinge = np.zeros((1, 3)), np.array([[0.0, 1.0, 0.0]])
    ankle = np.array([[0.6, 0.0, -1.2]])
    thigh, shin = reach(hip, ankle, hinge)
    end = THIGH * quaternions.rotate(thigh, DOWN) + SHIN * quaternions.rotate(shin, DOWN)
    assert end == pytest.approx(ankle * LONGEST_REACH / np.linalg.norm(ankle), abs=1e-9)


@given(st.floats(-1.2, 0.6), st.floats(-3.0, 3.0))
def test_a_foot_rolls_about_a_point_that_stays(pitch: float, yaw: float) -> None:
    place, pivot = np.array([0.3, -0.1, 0.0]), HEEL if pitch > 0 else BALL
    ankle = standing_ankle(place, np.array([pitch]), yaw)
    rotation = foot_rotation([pitch], yaw)
    flat = place - ANKLE_HEIGHT * DOWN + quaternions.rotate(quaternions.from_euler([yaw], "z"), pivot)
    assert ankle + quaternions.rotate(rotation, pivot) == pytest.approx(flat[None], abs=1e-12)
    for point in (HEEL, BALL):
        assert (ankle + quaternions.rotate(rotation, point))[0, 2] > -1e-12


def test_the_body_is_as_tall_and_as_balanced_as_it_says() -> None:
    clip = standing()
    ends = clip.end_positions()[0]
    lowest = clip.world_positions()[0, JOINTS.index("LeftFoot")] + HEEL
    assert ends[0, 2] - lowest[2] == pytest.approx(HEIGHT, abs=1e-12)
    assert np.ptp(np.linalg.norm(OFFSETS[[JOINTS.index(f"{side}Leg") for side in ("Left", "Right")]], axis=1)) == 0
    mass = center_of_mass(clip.world_positions())[0]
    assert mass[1] == pytest.approx(0.0, abs=1e-12)
    # Standing people's is near 0.56 of their height; raised arms, as in the rest pose, lift it by 0.03.
    assert 0.55 < (mass[2] - lowest[2]) / HEIGHT < 0.61


def test_balance_puts_the_center_of_mass_where_it_was_asked_to_be() -> None:
    frames = 5
    bent = np.linspace(0, 50, frames)
    hanging = Arm(**{angle: np.zeros(frames) for angle in ("flexion", "abduction", "twist", "elbow")})
    upper = Upper(
        pelvis=turned(pitch=0.6 * bent),
        chest=turned(pitch=bent),
        head=turned(pitch=0.3 * bent),
        arms={"Left": hanging, "Right": hanging},
    )
    target = np.column_stack([np.full(frames, 0.05), np.linspace(0, 0.03, frames), np.linspace(0.97, 0.75, frames)])
    feet = {side: on_ground(side, np.tile(spot(side), (frames, 1))) for side in ("Left", "Right")}
    clip = balanced(target, upper, lambda hips: feet).clip("bow", 60.0)
    assert center_of_mass(clip.world_positions()) == pytest.approx(target, abs=1e-5)
    for side in ("Left", "Right"):
        ankle = clip.world_positions()[:, clip.index(f"{side}Foot")]
        assert ankle == pytest.approx(np.tile(spot(side) - ANKLE_HEIGHT * DOWN, (frames, 1)), abs=1e-9)
