"""How a garment sits: rays, folds and gaps against closed forms, and what a broken measure would let through."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.signal import find_peaks

import cape
from cape.cloth.cloth import GridCloth
from cape.measure.wearing import across, folds, near_ray, prominent_maxima, ray_hits
from cape.results.fit import CLOSE, Fit, fit_of
from cape.results.take import Take
from tests.support.takes import take_of

UP = np.array([0.0, 0.0, 1.0])
ROUNDING = 1e-6  # m, of positions in single precision


def test_a_ray_meets_a_triangle_where_their_plane_equation_says():
    # The plane x + y + z = 1: the ray from (a, b, 0) upwards meets it at z = 1 - a - b, inside of the triangle.
    corners = np.eye(3)[None, None]
    origins = np.array([[0.2, 0.3, 0.0], [0.6, 0.6, 0.0], [0.2, 0.3, 0.6]])
    ways = ray_hits(origins, np.tile(UP, (3, 1)), np.repeat(corners, 3, axis=0))
    np.testing.assert_allclose(ways[:, 0], [0.5, np.inf, np.inf], rtol=1e-12)


def test_a_ray_along_a_triangle_misses_it():
    corners = np.array([[[[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]]])
    assert np.isinf(ray_hits(np.array([[0.0, 0.2, -1.0]]), UP[None], corners)).all()


@given(st.integers(0, 2**32 - 1))
def test_no_triangle_that_a_ray_meets_is_left_out(seed):
    rng = np.random.default_rng(seed)
    positions, triangles = rng.integers(-3, 4, (30, 3)).astype(float), rng.integers(0, 30, (60, 3))
    direction = rng.standard_normal(3) if seed % 2 else np.eye(3)[seed % 3]
    direction /= np.linalg.norm(direction)
    origin = rng.integers(-3, 4, 3).astype(float)
    ways = ray_hits(origin[None], direction[None], positions[triangles][None])[0]
    near = near_ray(origin, across(direction[None])[0], positions, triangles)
    assert set(np.flatnonzero(np.isfinite(ways))) <= set(near)


def test_few_triangles_are_near_a_ray():
    sheet = cape.Cloth.rectangle(width=1.0, height=1.0, spacing=0.05, down=(1.0, 0.0, 0.0))
    middle = sheet.positions.mean(axis=0) - [0.01, 0.02, 1.0]
    assert 1 <= len(near_ray(middle, across(UP[None])[0], sheet.positions, sheet.triangles)) <= 2


@given(st.lists(st.integers(0, 8), min_size=3, max_size=40), st.integers(1, 4))
def test_maxima_are_those_of_scipy(values, least):
    heights = np.array(values, dtype=float)
    peaks, found = find_peaks(heights, prominence=least, plateau_size=1)
    np.testing.assert_array_equal(prominent_maxima(heights, float(least)), found["left_edges"])
    assert len(peaks) == len(found["left_edges"])


@pytest.mark.parametrize("waves", [3, 8])
@pytest.mark.parametrize(("depth", "counted"), [(0.0051, True), (0.0049, False)])
@pytest.mark.parametrize("turned", [0.0, 0.4])
def test_a_hem_in_waves_has_as_many_folds_as_they_stand_out_by_a_centimetre(waves, depth, counted, turned):
    """The distance from the axis is 0.4 m + depth cos(waves t): crests are 2 depth above the troughs.

    Points every 64th of a wave are off a crest by at most depth (1 - cos(pi / 64)) < 0.13 % of it.
    """
    angles = turned + np.linspace(0.0, 2.0 * np.pi, 64 * waves, endpoint=False)
    radii = 0.4 + depth * np.cos(waves * angles)
    axis = np.array([0.6, 0.0, 0.8])
    across, beside = np.array([0.8, 0.0, -0.6]), np.array([0.0, 1.0, 0.0])
    origin = np.array([3.0, -2.0, 1.0])
    hem = origin + radii[:, None] * (np.cos(angles)[:, None] * across + np.sin(angles)[:, None] * beside)
    hem += np.linspace(-0.3, 0.5, len(angles))[:, None] * axis  # how low it hangs does not count
    assert folds(hem, origin, axis, closed=True) == (waves if counted else 0)


def flat(height: float, *, frames: int = 1) -> tuple[GridCloth, Take]:
    """A level sheet at a height [m] over a body of a ball of 0.1 m at each shoulder, and one of 0.05 m as its neck."""
    cloth = cape.Cloth.rectangle(width=1.0, height=1.0, spacing=0.1, origin=(-0.5, 0.5, height), down=(1.0, 0.0, 0.0))
    assert isinstance(cloth, GridCloth)
    still = np.tile([1.0, 0.0, 0.0, 0.0], (frames, 1))
    places = {
        "left_upper_arm": (0.0, 0.2, 0.0),
        "right_upper_arm": (0.0, -0.2, 0.0),
        "pelvis": (0.0, 0.0, -0.5),
        "neck": (0.0, 0.0, 0.1),
        "left_foot": (0.0, 0.1, -1.3),
        "right_foot": (0.0, -0.1, -1.4),
    }
    radii = {"left_upper_arm": 0.1, "right_upper_arm": 0.1, "neck": 0.05}
    take = take_of(
        np.repeat(cloth.positions[None], frames, axis=0),
        cloth.triangles,
        [cape.Sphere(name=bone, bone=bone, radius=radius) for bone, radius in radii.items()],
        poses={bone: (np.tile(place, (frames, 1)), still) for bone, place in places.items()},
    )
    return cloth, replace(take, bones=replace(take.bones, roles={name: name for name in places}))


@pytest.mark.parametrize(("over", "covered"), [(-0.001, 1.0), (0.001, 0.0)])
def test_cloth_covers_shoulders_within_six_centimetres_of_the_skin(over: float, covered: float):
    cloth, take = flat(0.1 + CLOSE + over)
    assert fit_of(take, cloth).shoulders_covered == covered


def test_both_shoulders_must_be_covered_and_frames_are_shares():
    cloth, take = flat(0.12, frames=4)
    places = take.positions.copy()
    places[3, :, 1] += 0.5  # the right shoulder is bare
    assert fit_of(replace(take, positions=places), cloth).shoulders_covered == 0.75


def test_a_hem_is_measured_from_the_ankles():
    cloth, take = flat(0.12)
    places = take.positions.copy()
    places[:, cloth.regions["bottom"][0], 2] -= 0.11  # of eleven points
    hem = fit_of(replace(take, positions=places), cloth).hem
    assert hem == pytest.approx(0.12 + 1.35 - 0.01, abs=ROUNDING)


def test_the_gap_of_a_collar_is_that_of_its_farthest_point():
    """A ring of 0.08 m around the middle of the neck's ball of 0.05 m, shifted by 5 mm more in each of 40 frames."""
    cloth, take = flat(0.12, frames=40)
    ring = 0.08 * np.exp(2j * np.pi * np.arange(11) / 11)
    places = take.positions.copy()
    places[:, :11] = np.stack([ring.real, ring.imag, np.full(11, 0.1)], axis=1)
    places[:, :11, 0] += 0.005 * np.arange(40)[:, None]
    collared = replace(cloth, regions={**cloth.regions, "collar": np.arange(22)})
    fit = fit_of(replace(take, positions=places), collared)
    # Its first point lies in the direction of the shift; the 95th percentile of 0 to 39 is 37.05.
    assert fit.collar_gap == pytest.approx(0.03 + 0.005 * 39, abs=ROUNDING)
    assert fit.collar_gap_p95 == pytest.approx(0.03 + 0.005 * 37.05, abs=ROUNDING)
    assert fit_of(take, cloth).collar_gap is None


def test_a_neck_may_be_carried_by_any_bone_below_the_head():
    """Many a skeleton's neck has no length of its own, and one above it has; shoulders nearby are no neck."""
    cloth, take = flat(0.12)
    collared = replace(cloth, regions={**cloth.regions, "collar": np.arange(22)})
    bones = take.bones
    roles = {**bones.roles, "neck": "pelvis", "head": "left_foot"}
    parents = np.full(len(bones.names), -1)
    parents[bones.index("left_foot")], parents[bones.index("neck")] = bones.index("neck"), bones.index("pelvis")
    above = replace(take, bones=replace(bones, roles=roles, parents=parents))
    assert fit_of(above, collared).collar_gap == fit_of(take, collared).collar_gap
    assert (
        fit_of(take, collared).collar_gap != fit_of(replace(take, bones=replace(bones, roles={})), collared).collar_gap
    )


def test_what_a_wearer_lacks_is_not_told():
    cloth, take = flat(0.12)
    assert fit_of(replace(take, bones=take.bones.select(["neck", "world"])), cloth) == Fit()
    assert fit_of(replace(take, colliders=()), cloth).shoulders_covered is None
