"""Cloth of any triangle mesh: what is refused, how triangles lie flat, and whether its springs are the fabric's."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from cape.assembly.grid_springs import grid_springs
from cape.assembly.mesh_springs import mesh_springs
from cape.assembly.springs import Springs
from cape.cloth.cloth import Cloth, MeshCloth, areas
from cape.cloth.fabric import Fabric
from cape.cloth.triangle_mesh import check_mesh, edges_of, locality_order, reordered
from motions.errors import ValueRangeError

SQUARE = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, -1.0]]
HALVES = [[0, 1, 2], [3, 2, 1]]
SPACING = 0.03


def sheet(
    rows: int, columns: int, *, flips: float = 0.0, jitter: float = 0.0, turn: float = 0.0, fabric: Fabric | None = None
) -> MeshCloth:
    """Cells split along diagonals, that share of them the other way, inner vertices moved and threads turned [rad]."""
    rng = np.random.default_rng(0)
    y, x = np.divmod(np.arange(rows * columns), columns)
    flat = np.stack([x, y], axis=1) * SPACING
    inner = (x > 0) & (x < columns - 1) & (y > 0) & (y < rows - 1)
    flat[inner] += jitter * SPACING * rng.uniform(-1, 1, (inner.sum(), 2))
    a = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    b, c, d = a + 1, a + columns, a + columns + 1
    flip = rng.random(len(a))[:, None] < flips
    one = np.where(flip, np.stack([a, c, d], axis=1), np.stack([a, c, b], axis=1))
    two = np.where(flip, np.stack([a, d, b], axis=1), np.stack([d, b, c], axis=1))
    flat = flat @ np.array([[np.cos(turn), np.sin(turn)], [-np.sin(turn), np.cos(turn)]])
    places = np.stack([0 * flat[:, 0], -flat[:, 0], -flat[:, 1]], axis=1)
    return Cloth.from_mesh(places, np.concatenate([one, two]), pattern=flat, fabric=fabric)


def stiffness_of(springs: Springs, pattern: np.ndarray) -> np.ndarray:
    """C1111, C2222, C1122, C1112, C2212 of all springs times the area [N m]: their energy under uniform strain."""
    d = pattern[springs.second] - pattern[springs.first]
    x, y = (d / np.linalg.norm(d, axis=1, keepdims=True)).T
    k = springs.stiffness * (d**2).sum(axis=1)
    return np.array([k @ x**4, k @ y**4, k @ (x * y) ** 2, k @ (x**3 * y), k @ (x * y**3)])


def bend_energy(springs: Springs, positions: np.ndarray) -> float:
    bent = np.einsum("km,kmi->ki", springs.bend_coefficients, positions[springs.bend_vertices])
    return float(springs.bend_stiffness @ (bent**2).sum(axis=1) / 2)


def rolled(pattern: np.ndarray, angle: float, radius: float) -> np.ndarray:
    """The pattern bent to a cylinder of that radius [m], the bent direction at an angle [rad] to the weft."""
    u, v = pattern @ [np.cos(angle), np.sin(angle)], pattern @ [-np.sin(angle), np.cos(angle)]
    return np.stack([radius * np.sin(u / radius), v, radius * (1 - np.cos(u / radius))], axis=1)


@pytest.mark.parametrize(
    ("positions", "triangles", "pattern", "text"),
    [
        ([[0.0, 0.0]], HALVES, None, r"positions must have the shape \(V, 3\), not \(1, 2\)"),
        (SQUARE, [[0, 1]], None, r"triangles must have the shape \(T, 3\)"),
        (SQUARE, np.zeros((0, 3), int), None, "at least one"),
        (SQUARE, [[0.0, 1.0, 2.0]], None, "whole numbers, not by float64"),
        ([*SQUARE[:3], [0.0, np.nan, 0.0]], HALVES, None, "positions of vertex 3 are not finite"),
        (SQUARE, [[0, 1, 2], [1, 2, 4]], None, "triangle 1 with vertices 1, 2, 4 is outside of a mesh of 4 vertices"),
        (SQUARE, [[0, 1, 2], [3, 2, -1]], None, "triangle 1 with vertices 3, 2, -1 is outside"),
        (SQUARE, [[0, 1, 2]], None, "vertex 3 belongs to no triangle"),
        (SQUARE, [[0, 1, 2], [3, 3, 1]], None, "triangle 1 with vertices 3, 3, 1 has no area"),
        (SQUARE, HALVES, [[0, 0], [1, 0], [0, 1], [0.5, 0.5]], "triangle 1 with vertices 3, 2, 1 has no area"),
        (SQUARE, HALVES, [[0, 0], [1, 0], [0, 1]], "the pattern has 3 vertices, but the mesh has 4"),
        (SQUARE[:3], [[0, 1, 2], [1, 2, 0]], None, "triangle 0 with vertices 0, 1, 2 is there twice"),
        (
            [*SQUARE, [1.0, 0.0, 0.0]],
            [*HALVES, [1, 2, 4]],
            None,
            "the edge of vertices 1, 2 belongs to 3 triangles, more than two",
        ),
    ],
)
def test_what_is_no_cloth_is_refused(positions, triangles, pattern, text: str):
    with pytest.raises(ValueRangeError, match=text):
        check_mesh(positions, triangles, pattern)


def test_interior_edges_know_both_their_triangles():
    edges = edges_of(np.array(HALVES))
    np.testing.assert_array_equal(edges.vertices, [[0, 1], [0, 2], [1, 2], [1, 3], [2, 3]])
    np.testing.assert_array_equal(edges.interior, [2])
    # From corner 1 of triangle 0 to the next, and likewise in triangle 1.
    np.testing.assert_array_equal(edges.sides, [[1, 4]])


def test_warp_hangs_down_and_level_triangles_have_threads_too():
    upright = check_mesh(SQUARE, HALVES).corners[0]
    np.testing.assert_allclose(upright * [np.sign(upright[1, 0]), 1], [[0, 0], [1, 0], [0, 1]], atol=1e-15)
    level = check_mesh([[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]], [[0, 1, 2]]).corners[0]
    np.testing.assert_allclose(np.abs(level), [[0, 0], [1, 0], [0, 1]], atol=1e-15)


@given(st.lists(st.floats(-1, 1), min_size=9, max_size=9))
def test_laying_flat_keeps_lengths(numbers: list[float]):
    points = np.array(numbers).reshape(3, 3) + np.array([[0, 0, 0], [3, 0, 0], [0, 3, 0]])
    corners = check_mesh(points, [[0, 1, 2]]).corners[0]
    for i, j in ((0, 1), (1, 2), (2, 0)):
        assert np.linalg.norm(corners[i] - corners[j]) == pytest.approx(np.linalg.norm(points[i] - points[j]))


def test_renumbering_changes_numbers_alone():
    cloth = sheet(12, 9, flips=0.5, jitter=0.3)
    shuffled = reordered(cloth, np.random.default_rng(1).permutation(cloth.vertices))
    order = locality_order(shuffled.faces, shuffled.positions)
    assert sorted(order) == list(range(cloth.vertices))
    ordered = reordered(shuffled, order)
    np.testing.assert_array_equal(ordered.positions, shuffled.positions[order])
    np.testing.assert_array_equal(ordered.pattern[ordered.faces], ordered.corners)
    ends = mesh_springs(ordered)
    # Neighbours of a front that crosses the sheet: no further apart than two fronts of a dozen vertices, and far less
    # than the hundred of random numbers.
    assert np.abs(ends.second - ends.first).max() <= 3 * 12
    before = stiffness_of(mesh_springs(cloth), cloth.pattern)
    # The fit stops before its last digits, at a place that depends on the order of springs.
    np.testing.assert_allclose(stiffness_of(ends, ordered.pattern), before, atol=1e-3 * before.max())


@pytest.mark.parametrize("fabric", [Fabric(), Fabric(shear=1000.0)], ids=["soft in shear", "stiff in shear"])
@pytest.mark.parametrize("flips", [0.0, 0.5])
def test_a_split_grid_has_the_springs_of_the_grid(fabric: Fabric, flips: float):
    cloth = sheet(9, 14, flips=flips, fabric=fabric)
    grid = Cloth.rectangle(width=13 * SPACING, height=8 * SPACING, spacing=SPACING, fabric=fabric)
    expected = stiffness_of(grid_springs(grid), grid.pattern)
    found = stiffness_of(mesh_springs(cloth), cloth.pattern)
    # Patches across cells take up to SHARPNESS of the area, 1e-6 over a squared misfit of some percent.
    np.testing.assert_allclose(found, expected, atol=1e-3 * expected.max())
    area = areas(cloth.corners).sum()
    np.testing.assert_allclose(found / area, [fabric.stretch, fabric.stretch, fabric.shear, 0, 0], atol=2.0)


@pytest.mark.parametrize("reverse", [False, True])
def test_the_borders_of_a_split_grid_carry_half_of_what_lies_within(reverse: bool):
    """However the vertices are numbered: of parallel sides of a cell no one may take all of its stiffness."""
    grid = Cloth.rectangle(width=0.5, height=0.5, spacing=0.1)
    cloth = Cloth.from_mesh(grid.positions, grid.triangles, pattern=grid.pattern)
    if reverse:
        cloth = reordered(cloth, np.arange(cloth.vertices)[::-1].copy())
    springs = mesh_springs(cloth)
    middle = (cloth.pattern[springs.first] + cloth.pattern[springs.second]) / 2.0
    way = np.abs(cloth.pattern[springs.first] - cloth.pattern[springs.second])
    for axis in (0, 1):
        along = springs.measured & (way[:, 1 - axis] < 1e-9)
        place = middle[:, 1 - axis]
        border = along & ((place < 1e-9) | (place > 0.5 - 1e-9))
        within = springs.stiffness[along & ~border]
        assert within == pytest.approx(within.mean(), rel=0.1)
        # The ridge falls by a tenth in each sweep, which is what a side that comes first may take more than its share.
        assert springs.stiffness[border] == pytest.approx(within.mean() / 2.0, rel=0.1)


@pytest.mark.parametrize(
    ("turn", "worst_stretch", "worst_shear"), [(0.0, 0.02, 0.16), (22.5, 0.06, 0.62), (45.0, 0.04, 0.32)]
)
def test_an_irregular_mesh_is_near_the_fabric(turn: float, worst_stretch: float, worst_shear: float):
    cloth = sheet(40, 40, flips=0.5, jitter=0.3, turn=np.radians(turn))
    fabric = cloth.fabric
    found = stiffness_of(mesh_springs(cloth), cloth.pattern) / areas(cloth.corners).sum()
    np.testing.assert_allclose(found[:2], fabric.stretch, rtol=worst_stretch)
    assert found[2] == pytest.approx(fabric.shear, rel=worst_shear)
    np.testing.assert_allclose(found[3:], 0.0, atol=0.015 * fabric.stretch_warp)


def test_layers_multiply_and_a_lone_triangle_holds():
    one = Cloth.from_mesh(SQUARE[:3], [[0, 1, 2]], pattern=[[0, 0], [1, 0], [0, 1]])
    springs = mesh_springs(one)
    assert len(springs.stiffness) == 3
    assert len(springs.bend_stiffness) == 0
    assert springs.stiffness.min() > 0.0
    from dataclasses import replace

    cloth = sheet(5, 5, flips=0.5, jitter=0.2)
    thick = mesh_springs(replace(cloth, layers=np.full(len(cloth.faces), 3.0)))
    np.testing.assert_allclose(thick.stiffness, 3.0 * mesh_springs(cloth).stiffness)
    np.testing.assert_allclose(thick.bend_stiffness, 3.0 * mesh_springs(cloth).bend_stiffness)


def test_nothing_is_stretched_where_it_is_flat():
    cloth = sheet(8, 8, flips=0.5, jitter=0.3)
    springs = mesh_springs(cloth)
    lengths = np.linalg.norm(cloth.positions[springs.second] - cloth.positions[springs.first], axis=1)
    np.testing.assert_allclose(springs.rest, lengths)
    assert bend_energy(springs, cloth.positions) == pytest.approx(0.0, abs=1e-25)
    # Measured are the edges alone: Euler's formula for a disc, E = V + T - 1.
    assert springs.measured.sum() == cloth.vertices + len(cloth.faces) - 1


@pytest.mark.parametrize("angle", [0.0, 90.0])
def test_a_split_grid_bends_along_its_threads_as_the_grid_does(angle: float):
    rows, columns, radius = 15, 21, 2.0
    cloth = sheet(rows, columns)
    grid = Cloth.rectangle(width=(columns - 1) * SPACING, height=(rows - 1) * SPACING, spacing=SPACING)
    positions = rolled(cloth.pattern, np.radians(angle), radius)
    energy = bend_energy(mesh_springs(cloth), positions)
    # The grid's end strips have half of their outer cells, those of the mesh theirs in whole triangles.
    assert energy == pytest.approx(bend_energy(grid_springs(grid), positions), rel=1e-3)
    cells = columns - 1 if angle == 0.0 else rows - 1
    bent = cloth.fabric.bend_warp / (2 * radius**2) * areas(cloth.corners).sum() * (cells - 1) / cells
    # Chords of h / radius: energy off by its square.
    assert energy == pytest.approx(bent, rel=1e-3)


@pytest.mark.parametrize("angle", [0.0, 30.0, 45.0, 60.0, 90.0])
def test_equilateral_triangles_bend_alike_in_all_directions(angle: float):
    rows, columns, h, radius = 60, 60, 0.02, 10.0
    y, x = np.divmod(np.arange(rows * columns), columns)
    flat = np.stack([(x + 0.5 * (y % 2)) * h, y * h * 3**0.5 / 2], axis=1)
    a = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    b, c, d = a + 1, a + columns, a + columns + 1
    odd = (a // columns % 2 == 1)[:, None]
    one = np.where(odd, np.stack([a, c, d], axis=1), np.stack([a, c, b], axis=1))
    two = np.where(odd, np.stack([a, d, b], axis=1), np.stack([d, b, c], axis=1))
    cloth = Cloth.from_mesh(np.insert(flat, 2, 0.0, axis=1), np.concatenate([one, two]), pattern=flat)
    energy = bend_energy(mesh_springs(cloth), rolled(flat, np.radians(angle), radius))
    # The hinges at the border are missing: one in some 60 along each side, with its neighbours' lesser mean.
    assert energy == pytest.approx(cloth.fabric.bend_warp / (2 * radius**2) * areas(cloth.corners).sum(), rel=0.03)


@pytest.mark.parametrize("angle", [0.0, 45.0, 90.0])
def test_an_irregular_mesh_bends_within_the_stated_factor(angle: float):
    cloth = sheet(60, 60, flips=0.5, jitter=0.3)
    energy = bend_energy(mesh_springs(cloth), rolled(cloth.pattern, np.radians(angle), 50.0))
    assert 0.9 < energy / (cloth.fabric.bend_warp / (2 * 50.0**2) * areas(cloth.corners).sum()) < 1.7


UNLIKE = Fabric(stretch=(2000.0, 400.0), shear=50.0, bend=(2e-5, 5e-6))


@pytest.mark.parametrize("flips", [0.0, 0.5])
def test_a_split_grid_has_the_springs_of_a_grid_of_unlike_threads(flips: float):
    cloth = sheet(9, 14, flips=flips, fabric=UNLIKE)
    found = stiffness_of(mesh_springs(cloth), cloth.pattern) / areas(cloth.corners).sum()
    # As above.
    np.testing.assert_allclose(found, [400.0, 2000.0, 50.0, 0.0, 0.0], atol=1e-3 * 2000.0)


@pytest.mark.parametrize(
    ("turn", "weft", "warp", "bend_weft", "bend_warp"),
    [(0.0, 0.95, 0.99, 1.33, 0.82), (45.0, 0.89, 0.97, 2.5, 0.51)],
)
def test_an_irregular_mesh_mixes_unlike_threads_as_stated(turn, weft, warp, bend_weft, bend_warp):
    cloth = sheet(60, 60, flips=0.5, jitter=0.3, turn=np.radians(turn), fabric=UNLIKE)
    springs, area = mesh_springs(cloth), areas(cloth.corners).sum()
    found = stiffness_of(springs, cloth.pattern)[:2] / area
    np.testing.assert_allclose(found, [weft * 400.0, warp * 2000.0], rtol=0.01)
    for angle, bend, share in ((0.0, UNLIKE.bend_weft, bend_weft), (90.0, UNLIKE.bend_warp, bend_warp)):
        energy = bend_energy(springs, rolled(cloth.pattern, np.radians(angle), 50.0))
        assert energy / (bend / (2 * 50.0**2) * area) == pytest.approx(share, rel=0.03)


def test_ragged_rows_are_refused_by_name():
    with pytest.raises(ValueRangeError, match="positions are not rows of equally many numbers"):
        Cloth.from_mesh([[0, 0, 0], [1, 0, 0], [0, 1]], [[0, 1, 2]])  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueRangeError, match="triangles are not rows of equally many numbers"):
        Cloth.from_mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2], [0, 1]])  # pyright: ignore[reportArgumentType]


def test_corners_that_start_at_one_place_are_refused():
    flat = [[0, 0], [1, 0], [0, 1]]
    with pytest.raises(ValueRangeError, match="vertices 2 and 0 of triangle 0 start at the same place"):
        Cloth.from_mesh([[0, 0, 0], [1, 0, 0], [0, 0, 0]], [[0, 1, 2]], pattern=flat)
