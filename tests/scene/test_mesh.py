"""Cloth of any triangle mesh: what is refused, how triangles lie flat, and whether its springs are the fabric's."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.sparse import csc_array, csr_array
from scipy.sparse.linalg import spsolve
from scipy.spatial import Delaunay

from cape.assembly.grid.springs import grid_springs
from cape.assembly.mesh import curvature
from cape.assembly.mesh.springs import mesh_springs
from cape.assembly.springs import Springs
from cape.cloth.cloth import Cloth, MeshCloth, areas
from cape.cloth.fabric import Fabric
from cape.cloth.triangle_mesh import check_mesh, edges_of, locality_order, reordered
from cape.report.measured.world import triangulations
from motions.errors import ValueRangeError

SQUARE = [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, -1.0]]
HALVES = [[0, 1, 2], [3, 2, 1]]
SPACING = 0.03
UNLIKE = Fabric(stretch=(2000.0, 400.0), shear=50.0, bend=(2e-5, 5e-6))


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
    before = mesh_springs(cloth)
    places = cloth.positions + 0.005 * np.random.default_rng(2).standard_normal(cloth.positions.shape)
    moved = places[np.random.default_rng(1).permutation(cloth.vertices)][order]
    assert before.membrane is not None
    assert ends.membrane is not None
    assert ends.membrane.energy(moved) == pytest.approx(before.membrane.energy(places), rel=1e-12)
    # Small differences of large sums.
    assert bend_energy(ends, moved) == pytest.approx(bend_energy(before, places), rel=1e-9)


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
        # What patches across cells take, as above.
        assert within == pytest.approx(within.mean(), rel=1e-3)
        assert springs.stiffness[border] == pytest.approx(within.mean() / 2.0, rel=1e-3)


@pytest.mark.parametrize("degrees", [0, 45])
@pytest.mark.parametrize("kind", ["one-way", "alternating"])
def test_springs_of_split_cells_cross_them_and_balance_under_even_strain(kind: str, degrees: int):
    """A longer spring is shorter than the bent sheet beside it; uneven ones give way to each other."""
    piece = triangulations.strip(kind, 12 * SPACING, 8 * SPACING, SPACING)
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    pattern = piece.points @ np.array([[c, s], [-s, c]])
    springs = mesh_springs(Cloth.from_mesh(np.insert(pattern, 2, 0.0, axis=1), piece.triangles, pattern=pattern))
    assert springs.membrane is None
    across = pattern[springs.second] - pattern[springs.first]
    length = np.linalg.norm(across, axis=1)
    assert length.max() == pytest.approx(2**0.5 * SPACING)
    strain = np.array([[0.01, 0.004], [0.004, -0.006]])
    pull = (springs.stiffness * np.einsum("ni,ij,nj->n", across, strain, across) / length**2)[:, None] * across
    forces = np.zeros_like(pattern)
    np.add.at(forces, springs.first, pull)
    np.add.at(forces, springs.second, -pull)
    inner = np.arange(len(pattern)) >= piece.border
    np.testing.assert_allclose(forces[inner], 0.0, atol=1e-3 * np.abs(pull).max())


STRAINS = {
    "weft": (0.01, 0.0, 0.0),
    "warp": (0.0, 0.01, 0.0),
    "bias": (0.005, 0.005, 0.01),
    "shear": (0.0, 0.0, 0.01),
    "both": (0.01, -0.004, 0.0),
}


@pytest.mark.parametrize("strain", STRAINS.values(), ids=STRAINS.keys())
@pytest.mark.parametrize("turn", [0.0, 22.5, 45.0])
def test_an_irregular_mesh_resists_even_strain_as_the_fabric_does(turn: float, strain: tuple[float, float, float]):
    cloth = sheet(12, 12, flips=0.5, jitter=0.3, turn=np.radians(turn), fabric=UNLIKE)
    membrane = mesh_springs(cloth).membrane
    assert membrane is not None
    weft, warp, angle = strain
    # F'F = 1 + 2 E by its root, and the whole turned.
    squared = np.array([[1 + 2 * weft, angle], [angle, 1 + 2 * warp]])
    values, vectors = np.linalg.eigh(squared)
    places = np.asarray(cloth.pattern @ (vectors * np.sqrt(values)) @ vectors.T, dtype=float)
    a, b = np.asarray(np.linalg.qr(np.random.default_rng(0).standard_normal((3, 2)))[0], dtype=float).T
    expected = 200.0 * weft**2 + 1000.0 * warp**2 + 50.0 * weft * warp + 25.0 * angle**2
    expected *= areas(cloth.corners).sum()
    assert membrane.energy(np.outer(places[:, 0], a) + np.outer(places[:, 1], b)) == pytest.approx(expected, rel=1e-9)


def test_springs_stay_where_they_are_the_fabric():
    for flips in (0.0, 0.5):
        assert mesh_springs(sheet(9, 9, flips=flips)).membrane is None
    for made in (sheet(9, 9, flips=0.5, jitter=0.1), sheet(9, 9, turn=0.3)):
        springs = mesh_springs(made)
        assert springs.membrane is not None
        np.testing.assert_array_equal(springs.stiffness, 0.0)


def test_a_membrane_edge_by_edge_has_the_same_energy():
    cloth = sheet(6, 7, flips=0.5, jitter=0.3)
    membrane = mesh_springs(cloth).membrane
    assert membrane is not None
    edges, places = membrane.edges(), cloth.positions + 0.01 * np.random.default_rng(0).standard_normal((42, 3))
    energy = 0.0
    for (i, j, m, n), (one, two), shares, area in zip(*edges, strict=True):
        strain = np.zeros(3)
        for (b0, b1, c0, c1), third, share in zip((one, two), (m, n), shares, strict=True):
            b, c = places[j] - places[i], places[third] - places[i]
            u, v = b0 * b + c0 * c, b1 * b + c1 * c
            strain += share * np.array([(u @ u - 1) / 2, (v @ v - 1) / 2, u @ v])
        energy += 0.5 * area * strain @ membrane.stiffness @ strain
    assert energy == pytest.approx(membrane.energy(places), rel=1e-12)


def test_layers_multiply_and_a_lone_triangle_holds():
    one = Cloth.from_mesh(SQUARE[:3], [[0, 1, 2]], pattern=[[0, 0], [1, 0], [0, 1]])
    springs = mesh_springs(one)
    assert len(springs.stiffness) == 3
    assert len(springs.bend_stiffness) == 0
    # Three springs can't be the fabric.
    assert springs.membrane is not None
    for jitter in (0.0, 0.2):
        cloth = sheet(5, 5, flips=0.5, jitter=jitter)
        thin, thick = mesh_springs(cloth), mesh_springs(replace(cloth, layers=np.full(len(cloth.faces), 3.0)))
        np.testing.assert_allclose(thick.stiffness, 3.0 * thin.stiffness)
        np.testing.assert_allclose(thick.bend_stiffness, 3.0 * thin.bend_stiffness)
        if thin.membrane is not None and thick.membrane is not None:
            np.testing.assert_allclose(thick.membrane.area, 3.0 * thin.membrane.area)
            np.testing.assert_allclose(thick.membrane.share, thin.membrane.share)


def test_nothing_is_stretched_where_it_is_flat():
    cloth = sheet(8, 8, flips=0.5, jitter=0.3)
    springs = mesh_springs(cloth)
    lengths = np.linalg.norm(cloth.positions[springs.second] - cloth.positions[springs.first], axis=1)
    np.testing.assert_allclose(springs.rest, lengths)
    assert bend_energy(springs, cloth.positions) == pytest.approx(0.0, abs=1e-25)
    # Measured are the edges alone: Euler's formula for a disc, E = V + T - 1.
    assert springs.measured.sum() == cloth.vertices + len(cloth.faces) - 1


def equilateral(rows: int, columns: int, h: float, fabric: Fabric | None = None) -> MeshCloth:
    """Equilateral triangles, a side along the weft."""
    y, x = np.divmod(np.arange(rows * columns), columns)
    flat = np.stack([(x + 0.5 * (y % 2)) * h, y * h * 3**0.5 / 2], axis=1)
    a = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
    b, c, d = a + 1, a + columns, a + columns + 1
    odd = (a // columns % 2 == 1)[:, None]
    one = np.where(odd, np.stack([a, c, d], axis=1), np.stack([a, c, b], axis=1))
    two = np.where(odd, np.stack([a, d, b], axis=1), np.stack([d, b, c], axis=1))
    triangles = np.concatenate([one, two])
    return Cloth.from_mesh(np.insert(flat, 2, 0.0, axis=1), triangles, pattern=flat, fabric=fabric)


MESHES = {
    "split one way": sheet(20, 20, fabric=UNLIKE),
    "split at random": sheet(20, 20, flips=0.5, fabric=UNLIKE),
    "equilateral": equilateral(20, 20, SPACING, UNLIKE),
    "irregular": sheet(20, 20, flips=0.5, jitter=0.3, fabric=UNLIKE),
    "irregular, turned": sheet(20, 20, flips=0.5, jitter=0.3, turn=0.5, fabric=UNLIKE),
}


@pytest.mark.parametrize("degrees", np.arange(8) * 22.5)
@pytest.mark.parametrize("cloth", MESHES.values(), ids=MESHES.keys())
@pytest.mark.few(
    "equilateral-0.0",
    "equilateral-22.5",
    "equilateral-112.5",
    "irregular, turned-0.0",
    "irregular, turned-22.5",
    "irregular, turned-112.5",
    "split at random-0.0",
    "split at random-22.5",
    "split at random-112.5",
    "split one way-0.0",
    "split one way-22.5",
    "split one way-112.5",
)
def test_a_cylinder_stores_the_fabric_s_energy_whatever_the_mesh_and_its_direction(cloth: MeshCloth, degrees: float):
    angle, radius = np.radians(degrees), 20.0
    energy = bend_energy(mesh_springs(cloth), rolled(cloth.pattern, angle, radius))
    expected = UNLIKE.bend_along(np.cos(angle) ** 2) / (2 * radius**2) * areas(cloth.corners).sum()
    # Curvature is exact for quadratics. A circle's next term is its fourth derivative, 1 / R^3, over some (2 h)^2.
    assert energy == pytest.approx(expected, rel=4 * SPACING**2 / radius**2 + 1e-6)


@pytest.mark.parametrize("cloth", MESHES.values(), ids=MESHES.keys())
def test_even_moments_are_in_equilibrium_within_a_mesh(cloth: MeshCloth):
    """What makes a sheet as stiff at rest under load as when it is bent by hand: forces of a cylinder are none."""
    springs, flat = mesh_springs(cloth), cloth.pattern
    quadratic = (flat @ [0.8, 0.6]) ** 2 / 2.0
    bent = springs.bend_stiffness * np.einsum("km,km->k", springs.bend_coefficients, quadratic[springs.bend_vertices])
    pushes = springs.bend_coefficients * bent[:, None]
    forces = np.bincount(springs.bend_vertices.ravel(), pushes.ravel(), len(flat))
    size = np.bincount(springs.bend_vertices.ravel(), np.abs(pushes).ravel(), len(flat))
    border = _steps_from_border(cloth)
    assert (border >= 4).sum() > 50
    np.testing.assert_allclose(forces[border >= 4], 0.0, atol=1e-9 * size.max())


def _steps_from_border(cloth: MeshCloth) -> np.ndarray:
    """How many edges each vertex is away from the border, shape (V,)."""
    edges = edges_of(cloth.faces)
    away = np.full(cloth.vertices, 99)
    away[edges.vertices[edges.triangles == 1]] = 0
    for _ in range(20):
        for a, b in (edges.vertices.T, edges.vertices.T[::-1]):
            np.minimum.at(away, a, away[b] + 1)
    return away


@pytest.mark.parametrize("flips", [0.0, 0.5])
def test_a_split_grid_has_the_springs_of_a_grid_of_unlike_threads(flips: float):
    cloth = sheet(9, 14, flips=flips, fabric=UNLIKE)
    found = stiffness_of(mesh_springs(cloth), cloth.pattern) / areas(cloth.corners).sum()
    # As above.
    np.testing.assert_allclose(found, [400.0, 2000.0, 50.0, 0.0, 0.0], atol=1e-3 * 2000.0)


def test_ragged_rows_are_refused_by_name():
    with pytest.raises(ValueRangeError, match="positions are not rows of equally many numbers"):
        Cloth.from_mesh([[0, 0, 0], [1, 0, 0], [0, 1]], [[0, 1, 2]])  # pyright: ignore[reportArgumentType]
    with pytest.raises(ValueRangeError, match="triangles are not rows of equally many numbers"):
        Cloth.from_mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2], [0, 1]])  # pyright: ignore[reportArgumentType]


def test_corners_that_start_at_one_place_are_refused():
    flat = [[0, 0], [1, 0], [0, 1]]
    with pytest.raises(ValueRangeError, match="vertices 2 and 0 of triangle 0 start at the same place"):
        Cloth.from_mesh([[0, 0, 0], [1, 0, 0], [0, 0, 0]], [[0, 1, 2]], pattern=flat)


def scattered(seed: int, cells: int) -> tuple[np.ndarray, np.ndarray]:
    """Points (V, 2) at random in a unit square, none nearer to another than 0.72 / cells, and Delaunay's triangles."""
    rng, size = np.random.default_rng(seed), 1.0 / cells
    edge = np.linspace(0.0, 1.0, cells + 1)
    points = [(u, v) for u in edge for v in (0.0, 1.0)] + [(u, v) for v in edge[1:-1] for u in (0.0, 1.0)]
    misses = 0
    while misses < 500:
        point = rng.uniform(0.5 * size, 1.0 - 0.5 * size, 2)
        near = np.hypot(*(np.array(points) - point).T).min() < 0.72 * size
        misses = misses + 1 if near else 0
        points += [] if near else [tuple(point)]
    places = np.array(points)
    triangles = Delaunay(places).simplices
    a, b = (places[triangles[:, k]] - places[triangles[:, 0]] for k in (1, 2))
    return places, triangles[np.abs(a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]) > 1e-9]


@pytest.mark.extra
def test_how_fast_slopes_forget_distant_vertices_hardly_matters(monkeypatch: pytest.MonkeyPatch):
    """Plates whose border is held on sin (W u + a) sin (F v + b), under the load that has them bend to it within.

    The power is chosen on these meshes, which judge nothing else.
    """
    cells, bend_warp, bend_weft = 16, 1.0, 0.1
    weft, warp = 2.2 * np.pi, 1.5 * np.pi
    chosen, errors = curvature.FALL, {}
    for power in (6, chosen, 16):
        monkeypatch.setattr(curvature, "FALL", power)
        squares = []
        for seed in (11, 12):
            places, triangles = scattered(seed, cells)
            fabric = Fabric(bend=(bend_warp, bend_weft))
            cloth = Cloth.from_mesh(np.insert(places, 2, 0.0, axis=1), triangles, pattern=places, fabric=fabric)
            springs = mesh_springs(cloth)
            rows = np.repeat(np.arange(len(springs.bend_stiffness)), springs.bend_vertices.shape[1])
            shape = (len(springs.bend_stiffness), cloth.vertices)
            bends = csr_array((springs.bend_coefficients.ravel(), (rows, springs.bend_vertices.ravel())), shape)
            matrix = csr_array(bends.T @ (springs.bend_stiffness[:, None] * bends.toarray()))
            u, v = cloth.pattern.T
            shape_of = np.sin(weft * u + 0.4) * np.sin(warp * v + 0.9)
            twist = 2.0 * (bend_weft * bend_warp) ** 0.5 * (weft * warp) ** 2
            load = (bend_weft * weft**4 + twist + bend_warp * warp**4) * shape_of * cloth.masses() / fabric.density
            free = np.minimum(np.minimum(u, 1.0 - u), np.minimum(v, 1.0 - v)) > 2.2 / cells
            pushed = (load - matrix[:, ~free] @ shape_of[~free])[free]
            found = spsolve(csc_array(matrix[free][:, free]), pushed)
            squares.append(np.mean((found - shape_of[free]) ** 2) / np.mean(shape_of[free] ** 2))
        errors[power] = float(np.sqrt(np.mean(squares)))
    # Of second order in the cells, of which half a wave has 16 / 2.2: some (pi / 7.3)^2 / 12, and here less.
    assert max(errors.values()) < (2.2 * np.pi / cells) ** 2 / 12.0
    assert errors[chosen] < 1.2 * min(errors.values())
