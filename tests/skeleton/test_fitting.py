"""Capsules fitted to points: they hold what they promise and are hardly larger than they need be, anywhere."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from motions import quaternions
from motions.errors import ValueRangeError
from skeleton.robot import capsule_fitting
from skeleton.robot.capsule_fitting import fit_capsule, fit_solids, fit_tapered_capsule, hull_volume, surface_points
from skeleton.shapes import Box, Capsule, Plane, Sphere, TaperedCapsule
from skeleton.solid_measures import signed_distance, union_volume, volume

FloatArray = NDArray[np.float64]

ROUNDING = 1e-9
SEARCH = (
    0.05  # of the volume: what the search may miss, twice the worst of 20 links against 1500 trials with all points
)

FITS = {"capsule": fit_capsule, "tapered capsule": fit_tapered_capsule}
fits = pytest.mark.parametrize("fit", FITS.values(), ids=FITS)
few = settings(max_examples=6, deadline=None)
turns = st.tuples(*(st.floats(-1, 1),) * 4).filter(lambda q: np.linalg.norm(q) > 0.1).map(np.array)
places = st.tuples(*(st.floats(-2.0, 2.0),) * 3).map(np.array)


def turned(points: FloatArray, turn: FloatArray) -> FloatArray:
    return quaternions.rotate(turn / np.linalg.norm(turn), points)


def on_surface(length: float, first: float, last: float, count: int = 400) -> FloatArray:
    """Points on the convex hull of a sphere at the origin and one at `length` on +Z, shape (N, 3)."""
    golden = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
    heights = 1.0 - 2.0 * (np.arange(count) + 0.5) / count
    flat = np.sqrt(1.0 - heights**2)
    ball = np.stack([flat * np.cos(golden), flat * np.sin(golden), heights], axis=1)
    shares = np.linspace(0.0, 1.0, 7)
    points = np.concatenate([[0, 0, s * length] + ((1 - s) * first + s * last) * ball for s in shares])
    solid = TaperedCapsule(end=np.array([0.0, 0.0, length]), start_radius=first, end_radius=last)
    return points[signed_distance(solid, points) > -0.02 * max(first, last)]


def held(solids, points: FloatArray, weights: FloatArray | None = None) -> float:
    """Share of the points that lie in the solids."""
    weights = np.ones(len(points)) if weights is None else weights
    distances = np.min([signed_distance(solid, points) for solid in solids], axis=0)
    return float(weights[distances <= ROUNDING].sum() / weights.sum())


# -- volumes --


@settings(max_examples=30, deadline=None)
@given(st.floats(0.0, 2.0), st.floats(0.05, 1.0), st.floats(0.05, 1.0))
def test_volume_of_a_tapered_capsule_is_that_of_all_spheres_between(length: float, first: float, last: float):
    # Between spheres 5 mm apart lie grooves of (5 mm)^2 / 8 r, 0.06 mm, on a surface of 2 pi 1 m 2 m at most.
    shares = np.linspace(0.0, 1.0, 401)[:, None]
    heights = np.linspace(-1.0, 3.0, 4001)
    squares = ((1.0 - shares) * first + shares * last) ** 2 - (heights - shares * length) ** 2
    slices = np.pi * np.maximum(squares.max(axis=0), 0.0)
    solid = TaperedCapsule(end=np.array([0.0, 0.0, length]), start_radius=first, end_radius=last)
    assert volume(solid) == pytest.approx(np.trapezoid(slices, heights), abs=1e-3)


def test_volumes_of_the_other_solids():
    ball = 4.0 / 3.0 * np.pi * 0.3**3
    assert volume(Sphere(radius=0.3)) == pytest.approx(ball, rel=1e-12)
    assert volume(Box(half_sizes=np.array([0.5, 1.0, 2.0]))) == 8.0
    assert volume(Plane()) == np.inf
    capsule = Capsule("c", None, np.zeros(3), np.array([0.0, 3.0, 4.0]), 0.3)
    assert volume(capsule) == pytest.approx(ball + 5.0 * np.pi * 0.3**2, rel=1e-12)


def test_what_solids_share_counts_once():
    ball = Sphere(radius=0.5)
    apart = Sphere(center=np.array([3.0, 0.0, 0.0]), radius=0.5)
    box = Box(half_sizes=np.full(3, 0.5), rotation_wxyz=np.array([np.sqrt(0.5), 0.0, 0.0, np.sqrt(0.5)]))
    assert union_volume([ball, ball]) == pytest.approx(volume(ball), rel=0.05)
    assert union_volume([ball, apart], across=60) == pytest.approx(2.0 * volume(ball), rel=0.05)
    assert union_volume([ball, box]) == pytest.approx(1.0, rel=0.05)


# -- the smallest solid --


@few
@given(st.floats(0.0, 5.0), st.floats(0.3, 1.0), turns, places)
def test_a_tapered_capsule_is_found_again(length: float, taper: float, turn: FloatArray, place: FloatArray):
    # The hull of the points is in every solid that holds them; the true solid is one that does.
    true = TaperedCapsule(end=np.array([0.0, 0.0, length]), start_radius=1.0, end_radius=taper)
    points = turned(on_surface(length, 1.0, taper), turn) + place
    found = fit_tapered_capsule(points, quantile=1.0)
    assert hull_volume(points) <= volume(found) <= (1.0 + SEARCH) * volume(true)
    assert held([found], points) == 1.0


@few
@given(st.floats(0.0, 8.0), turns, places)
def test_a_capsule_is_found_again(length: float, turn: FloatArray, place: FloatArray):
    points = turned(on_surface(length, 1.0, 1.0), turn) + place
    found = fit_capsule(points, quantile=1.0)
    true = Capsule("true", None, np.zeros(3), np.array([0.0, 0.0, length]), 1.0)
    assert hull_volume(points) <= volume(found) <= (1.0 + SEARCH) * volume(true)
    if length > 2.0:
        along = (found.end - found.start) / np.linalg.norm(found.end - found.start)
        # A surface that leaned over half the length by more than 5 % of the radius would be thicker by that.
        assert abs(along @ turned(np.array([0.0, 0.0, 1.0]), turn)) > np.cos(2.0 * SEARCH / length + 0.05)
        assert found.radius == pytest.approx(1.0, rel=SEARCH)


@fits
@few
@given(st.integers(0, 2**31), st.floats(0.5, 1.0))
def test_the_share_that_was_asked_for_is_held(fit, seed: int, quantile: float):
    rng = np.random.default_rng(seed)
    points = rng.standard_normal((150, 3)) * rng.uniform(0.01, 1.0, 3)
    weights = rng.uniform(0.0, 1.0, 150) ** 3
    share = held([fit(points, weights=weights, quantile=quantile)], points, weights)
    assert share >= quantile - ROUNDING
    if fit is fit_capsule:
        # The radius is one point's distance: without it the share would not be reached.
        assert share - weights.max() / weights.sum() <= quantile


@fits
def test_outliers_beyond_the_share_do_not_count(fit):
    points = on_surface(3.0, 1.0, 0.6)
    spoiled = np.concatenate([points, np.tile([0.0, 40.0, 0.0], (len(points) // 60, 1))])
    assert volume(fit(spoiled, quantile=0.98)) <= (1.0 + SEARCH) * volume(fit(points, quantile=1.0))
    assert volume(fit(spoiled, quantile=1.0)) > 3.0 * volume(fit(points, quantile=1.0))


@fits
@few
@given(turns, places, st.floats(-3.0, 3.0).map(lambda x: 10.0**x), st.booleans())
def test_neither_place_nor_size_nor_reflection_matters(
    fit, turn: FloatArray, place: FloatArray, scale: float, reflected: bool
):
    points = BLOB
    flip = np.array([-1.0, 1.0, 1.0]) if reflected else np.ones(3)
    moved = scale * (turned(points * flip, turn) + place)
    before, after = fit(points), fit(moved)
    # Rounding of the principal axes, 1e-15, grows no faster than tenfold in each of a simplex's some 100 steps of size
    # 1e-4 at last: ends are compared with that last step, the volume with its square's effect near a least value.
    assert volume(after) == pytest.approx(scale**3 * volume(before), rel=1e-3)
    for end, expected in ((after.start, before.start), (after.end, before.end)):
        assert end == pytest.approx(scale * (turned(expected * flip, turn) + place), abs=1e-2 * scale)


BLOB = on_surface(3.0, 1.0, 0.5) * [1.0, 0.7, 1.0] + [0.3, 0.0, 0.0] * on_surface(3.0, 1.0, 0.5)[:, [2, 0, 0]] ** 2


# -- which and how many --


def kinds_of(solids) -> list[str]:
    return [type(solid).__name__ for solid in solids]


def test_a_taper_has_to_pay():
    slight, steep = on_surface(3.0, 1.0, 0.97), on_surface(3.0, 1.0, 0.5)
    assert kinds_of(fit_solids(slight)) == ["Capsule"]
    assert kinds_of(fit_solids(steep)) == ["TaperedCapsule"]
    assert kinds_of(fit_solids(steep, kinds=[Capsule])) == ["Capsule"]
    assert kinds_of(fit_solids(slight, kinds=[TaperedCapsule])) == ["TaperedCapsule"]


def box_surface(sizes: tuple[float, float, float]) -> tuple[FloatArray, FloatArray]:
    import trimesh

    box = trimesh.creation.box(extents=sizes)
    return surface_points(np.asarray(box.vertices), np.asarray(box.faces))


def test_a_broad_thing_gets_several_side_by_side():
    points, weights = box_surface((0.25, 1.0, 0.8))
    one = fit_solids(points, weights=weights, most=1)
    several = fit_solids(points, weights=weights)
    assert len(one) == 1
    assert len(several) > 1
    assert union_volume(several) < (1.0 - capsule_fitting.SPLIT_SAVING) * volume(one[0])
    assert held(several, points, weights) >= capsule_fitting.QUANTILE
    # They stand next to each other along one of the broad sides, not before each other.
    middles = np.array([(solid.start + solid.end) / 2.0 for solid in several])
    assert np.ptp(middles[:, 1:], axis=0).max() > 0.2
    assert np.ptp(middles[:, 0]) < 0.05
    saved = volume(one[0]) - union_volume(several)
    assert len(fit_solids(points, weights=weights, least_saving=2.0 * saved)) == 1


def test_a_thing_that_one_solid_fills_gets_one():
    assert len(fit_solids(on_surface(3.0, 1.0, 1.0))) == 1


# -- surfaces --


def test_points_of_a_mesh_stand_for_its_area():
    points, areas = box_surface((1.0, 2.0, 3.0))
    assert areas.sum() == pytest.approx(22.0, rel=1e-12)
    assert (np.abs(points) / [0.5, 1.0, 1.5]).max(axis=1) == pytest.approx(np.ones(len(points)), abs=1e-12)
    # No edge of a face is longer than 6 % of the diagonal, so no place is farther than that from a point.
    places = np.random.default_rng(0).uniform(-1.0, 1.0, (50, 3)) * [0.5, 1.0, 1.5]
    places[:, 2] = 1.5
    nearest = np.linalg.norm(points[None] - places[:, None], axis=2).min(axis=1)
    assert nearest.max() <= 0.06 * np.sqrt(14.0)
    # A face has its share of the points' areas, but for what its rim shares with its neighbours.
    top = areas[points[:, 2] == 1.5].sum()
    rim = 6.0 * 0.06 * np.sqrt(14.0)
    assert 2.0 - rim <= top <= 2.0 + rim


@pytest.mark.parametrize(
    ("vertices", "triangles"),
    [(np.zeros((0, 3)), []), (np.zeros((3, 3)), [[0, 1, 2]]), (np.eye(3), []), (np.eye(3), [[0, 1, 1]])],
    ids=["empty", "in one place", "no face", "face of no area"],
)
def test_a_mesh_without_area_is_refused(vertices: FloatArray, triangles: list[list[int]]):
    with pytest.raises(ValueRangeError, match="no area"):
        surface_points(vertices, np.array(triangles, dtype=np.int64).reshape(-1, 3))


# -- degenerate points --

LINE = np.linspace(0.0, 1.0, 20)[:, None] * [1.0, 2.0, 2.0]
FLAT = np.array([[x, y, 0.0] for x in np.linspace(0.0, 1.0, 9) for y in np.linspace(0.0, 0.4, 5)])


@fits
@pytest.mark.parametrize(
    "points",
    [LINE, FLAT, LINE[[0, 19]], np.repeat(FLAT, 3, axis=0), np.repeat(LINE[[0, 19]], [40, 1], axis=0)],
    ids=["on a line", "in a plane", "two", "thrice the same", "all but one in a place"],
)
@pytest.mark.few(
    "in a plane-capsule", "on a line-tapered capsule", "two-capsule", "all but one in a place-tapered capsule"
)
def test_degenerate_points_get_a_valid_solid(fit, points: FloatArray):
    for quantile in (0.9, 1.0):
        solid = fit(points, quantile=quantile)
        assert 0.0 < volume(solid) < np.inf
        assert held([solid], points) >= quantile
        assert held(fit_solids(points, quantile=quantile), points) >= quantile


def test_a_capsule_around_a_line_is_a_thousandth_of_it_thick():
    solid = fit_capsule(LINE, quantile=1.0)
    assert 0.003 * (1.0 - ROUNDING) <= solid.radius < 0.03
    assert np.linalg.norm(solid.end - solid.start) == pytest.approx(3.0, abs=0.06)


@fits
@pytest.mark.parametrize(
    ("arguments", "options", "word"),
    [
        ([[1.0, 2.0, 3.0]], {}, "one place"),
        ([[1.0, 2.0, 3.0]] * 5, {}, "one place"),
        ([], {}, "shape"),
        ([1.0, 2.0, 3.0], {}, "shape"),
        ([[0.0, 0.0, np.nan], [1.0, 0.0, 0.0]], {}, "finite"),
        (LINE, {"weights": [1.0]}, "weight"),
        (LINE, {"weights": -np.ones(20)}, "weight"),
        (LINE, {"weights": np.zeros(20)}, "weight"),
        (LINE, {"quantile": 0.0}, "share"),
        (LINE, {"quantile": 1.5}, "share"),
        (LINE, {"quantile": np.nan}, "share"),
    ],
)
def test_what_makes_no_sense_is_refused(fit, arguments, options: dict, word: str):
    with pytest.raises(ValueRangeError, match=word):
        fit(arguments, **options)
