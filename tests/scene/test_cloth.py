"""What a scene is made of: the cut of a cloth, its fabric, the air, attachments, and how bad values are refused."""

import math
from collections import Counter
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cape import (
    FABRICS,
    XPBD,
    Box,
    Cloth,
    Fabric,
    Plane,
    Scene,
    Simulation,
    Sphere,
    SymplecticEuler,
    UserError,
    Wind,
    attach,
    fabric,
    solver,
)
from cape.assembly.springs import springs_of
from cape.assembly.stability import largest_frequency, largest_step, stable_step
from cape.cloth.cloth import GridCloth
from motions.errors import UnknownNameError, ValueRangeError

CUTS = {
    "rectangle": Cloth.rectangle(width=0.7, height=0.4, spacing=0.1),
    "smallest rectangle": Cloth.rectangle(width=0.1, height=0.1, spacing=0.1),
    "cape": Cloth.cape(length=0.9, flare=2.2, spacing=0.04),
}
cuts = pytest.mark.parametrize("cloth", CUTS.values(), ids=CUTS)


def neckline_length(cloth: GridCloth) -> float:
    """Length of the top row in the pattern, as the arc that its chords belong to [m]."""
    assert cloth.neckline is not None
    top = cloth.pattern[: cloth.columns]
    return float(np.linalg.norm(np.diff(top, axis=0), axis=1).sum())


def test_a_rectangle_has_its_size_and_place():
    cloth = Cloth.rectangle(
        width=1.0, height=0.5, spacing=0.15, origin=(1, 2, 3), right=(0, 0, 5), down=(-2, 0, 0), fabric=FABRICS["denim"]
    )
    # 6.7 and 3.3 cells are rounded to whole ones.
    assert (cloth.rows, cloth.columns, cloth.vertices) == (4, 8, 32)
    np.testing.assert_allclose(cloth.positions[[0, 7, 24, 31]], [[1, 2, 3], [1, 2, 4], [0.5, 2, 3], [0.5, 2, 4]])
    np.testing.assert_allclose(cloth.pattern[-1], [1.0, 0.5])
    assert cloth.masses().sum() == pytest.approx(0.5 * FABRICS["denim"].density, rel=1e-12)


@pytest.mark.parametrize("flare", [1.2, 1.8, 3.0])
@pytest.mark.parametrize("spacing", [0.04, 0.02])
def test_a_cape_weighs_what_its_annular_sector_weighs(flare: float, spacing: float):
    length = 1.1
    cloth = Cloth.cape(length=length, flare=flare, spacing=spacing, hem_layers=1)
    plain = replace(cloth, layers=None)
    inner = neckline_length(cloth)
    # Mean width times length. Chords are shorter than their arcs: each cell spans angle / (columns - 1).
    angle = inner * (flare - 1) / length / (cloth.columns - 1)
    area = inner * (1 + flare) / 2 * length
    assert plain.masses().sum() == pytest.approx(area * plain.fabric.density, rel=angle**2 / 6 + 1e-12)
    assert np.ptp(np.linalg.norm(np.diff(cloth.pattern[-cloth.columns :], axis=0), axis=1)) < 1e-12


@pytest.mark.parametrize("spacing", [0.06, 0.03, 0.015, 0.0075])
def test_a_cape_weighs_the_same_at_any_spacing(spacing: float):
    """Its hem is 2.4 cm wide, of 5 layers; its collar is 4.8 cm wide, of 10.

    What is integrated here are circles; their chords are shorter by angle^2 / 24 and the areas between two of them by
    angle^2 / 6, and a share of a cell's height isn't quite one of its area.
    """
    length, flare, hem, layers = 1.1, 2.0, 0.024, 5
    cloth = Cloth.cape(length=length, flare=flare, spacing=spacing, hem_layers=layers)
    inner = neckline_length(cloth)
    angle = inner * (flare - 1) / length
    radius = inner / angle

    def sector(first: float, last: float) -> float:
        return angle / 2 * (last**2 - first**2)

    collar = sector(radius, radius + 2 * hem)
    end = sector(radius + length - hem, radius + length)
    sides = 2 * hem * (length - 3 * hem)
    area = sector(radius, radius + length) + (2 * layers - 1) * collar + (layers - 1) * (end + sides)
    # The strip at the end begins within a cell, of which it takes the share of the height: at most a quarter of a
    # cell's height times the change of width over it is off, in each of the strips.
    cell = length / (cloth.rows - 1)
    off = (3 * layers - 2) * angle * cell**2 / 8 + area * (angle / (cloth.columns - 1)) ** 2 / 6
    assert cloth.masses().sum() == pytest.approx(area * cloth.fabric.density, abs=off * cloth.fabric.density)


def test_layers_weigh():
    cloth = CUTS["cape"]
    assert cloth.layers is not None
    cells = replace(cloth, layers=None, fabric=Fabric(density=1.0))
    faces, pattern = cells.triangles, cells.pattern
    edges = pattern[faces[:, 1]] - pattern[faces[:, 0]], pattern[faces[:, 2]] - pattern[faces[:, 0]]
    areas = np.abs(edges[0][:, 0] * edges[1][:, 1] - edges[0][:, 1] * edges[1][:, 0]) / 2
    expected = (areas * np.tile(cloth.layers.ravel(), 2)).sum() * cloth.fabric.density
    assert cloth.masses().sum() == pytest.approx(expected, rel=1e-12)
    assert cloth.masses().min() > 0


@cuts
def test_triangles_form_one_oriented_sheet(cloth: GridCloth):
    faces = cloth.triangles
    assert faces.shape == (2 * (cloth.rows - 1) * (cloth.columns - 1), 3)
    directed = Counter((int(a), int(b)) for face in faces for a, b in zip(face, np.roll(face, -1), strict=True))
    # Each direction of an edge belongs to one triangle at most; inner edges have both.
    assert set(directed.values()) == {1}
    border = [edge for edge in directed if edge[::-1] not in directed]
    assert len(border) == 2 * (cloth.rows - 1 + cloth.columns - 1)
    # Euler's formula for a disc: V - E + F = 1.
    edges = {frozenset(edge) for edge in directed}
    assert cloth.vertices - len(edges) + len(faces) == 1
    assert set(np.unique(faces)) == set(range(cloth.vertices))


@cuts
def test_springs_rest_at_the_pattern_and_stay_on_the_grid(cloth: GridCloth):
    springs = springs_of(cloth)
    first, second = springs.first, springs.second
    assert (springs.stiffness > 0).all()
    lengths = np.linalg.norm(cloth.pattern[second] - cloth.pattern[first], axis=1)
    np.testing.assert_allclose(lengths, springs.rest, rtol=1e-12)
    rows, columns = np.divmod(np.stack([first, second]), cloth.columns)
    assert (np.abs(np.diff(rows, axis=0)) <= 1).all()
    assert (np.abs(np.diff(columns, axis=0)) <= 1).all()
    r, c = cloth.rows, cloth.columns
    assert len(first) == r * (c - 1) + (r - 1) * c + 2 * (r - 1) * (c - 1)
    assert springs.measured.sum() == r * (c - 1) + (r - 1) * c
    assert (springs.bend_stiffness > 0).all()
    lines, cells = r * max(c - 2, 0) + max(r - 2, 0) * c, (r - 1) * (c - 1)
    coefficients = np.repeat([[1, -2, 1, 0], [1, -1, -1, 1]], [lines, cells], axis=0)
    np.testing.assert_array_equal(springs.bend_coefficients, coefficients)
    start, middle, end, _ = springs.bend_vertices[:lines].T
    np.testing.assert_array_equal(end - middle, middle - start)
    straight = np.where(middle - start == 1, start % c + 2 < c, end < cloth.vertices)
    assert straight.all()
    quads = np.arange(cloth.vertices).reshape(r, c)[:-1, :-1].ravel()[:, None] + [0, 1, c, c + 1]
    np.testing.assert_array_equal(springs.bend_vertices[lines:], quads)


@cuts
def test_regions_and_texture_coordinates(cloth: GridCloth):
    grid = np.arange(cloth.vertices).reshape(cloth.rows, cloth.columns)
    for name, expected in {"top": grid[0], "bottom": grid[-1], "left": grid[:, 0], "right": grid[:, -1]}.items():
        np.testing.assert_array_equal(cloth.region(name), expected)
    assert cloth.texcoords.dtype == np.float32
    np.testing.assert_array_equal(cloth.texcoords[[0, cloth.columns - 1, -1]], [[0, 0], [1, 0], [1, 1]])


@pytest.mark.parametrize("cloth", [CUTS["rectangle"], CUTS["cape"]], ids=["rectangle", "cape"])
def test_the_top_row_is_its_two_ends_and_its_middle(cloth: GridCloth):
    parts = [cloth.region(name) for name in ("top_left", "top_middle", "top_right")]
    np.testing.assert_array_equal(np.concatenate(parts), cloth.region("top"))
    assert len(parts[0]) == len(parts[2]) >= 2


def test_a_shoulder_holds_an_eighth_of_the_top_row_to_the_nearest_vertex():
    held = {
        cloth.columns: len(cloth.region("top_left"))
        for cloth in (Cloth.cape(length=1.1, spacing=spacing) for spacing in (0.03, 0.025, 0.02, 0.015))
    }
    # Of 18, 22, 27 and 36 cells: 2.25, 2.75, 3.4 and 4.5.
    assert held == {19: 2, 23: 3, 28: 3, 37: 4}


def test_a_cape_is_worn_around_the_back_of_the_neck():
    cloth = CUTS["cape"]
    assert cloth.neckline is not None
    left, middle, right = cloth.neckline[0], cloth.neckline[cloth.columns // 2], cloth.neckline[-1]
    # x forward, y left, z up.
    assert left[1] > 0 > right[1]
    assert middle[0] < min(left[0], right[0])
    np.testing.assert_allclose(cloth.neckline, cloth.neckline[::-1] * [1, -1, 1], atol=1e-3)
    held = np.linalg.norm(np.diff(cloth.neckline[cloth.region("top_left")], axis=0), axis=1)
    # Where the shoulders hold it, it is neither stretched nor slack, but for chords of the curve.
    top = np.linalg.norm(np.diff(cloth.pattern[: len(held) + 1], axis=0), axis=1)
    np.testing.assert_allclose(held, top, rtol=0.01)


def test_arrays_of_a_cloth_are_read_only():
    for array in (CUTS["cape"].positions, CUTS["cape"].pattern, CUTS["cape"].region("top")):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0


# -- the largest stable step --


def stiffness_matrix(cloth: GridCloth, positions: np.ndarray | None = None) -> np.ndarray:
    """Hessian of the springs' energy at rest or at positions (V, 3), vertex by vertex, shape (3 V, 3 V)."""
    springs, size = springs_of(cloth), cloth.vertices
    positions = cloth.positions if positions is None else positions
    matrix = np.zeros((size, 3, size, 3))
    for i, j, k, rest in zip(springs.first, springs.second, springs.stiffness, springs.rest, strict=True):
        length = np.linalg.norm(positions[j] - positions[i])
        u = (positions[j] - positions[i]) / length
        along = np.outer(u, u)
        own = k * (along + (1.0 - rest / length) * (np.eye(3) - along))
        for a, b, sign in ((i, i, 1), (j, j, 1), (i, j, -1), (j, i, -1)):
            matrix[a, :, b, :] += sign * own
    bends = springs.bend_vertices, springs.bend_coefficients, springs.bend_stiffness
    for members, coefficients, k in zip(*bends, strict=True):
        for a, wa in zip(members, coefficients, strict=True):
            for b, wb in zip(members, coefficients, strict=True):
                matrix[a, :, b, :] += k * wa * wb * np.eye(3)
    return matrix.reshape(3 * size, 3 * size)


def test_the_largest_frequency_is_that_of_the_stiffness_matrix():
    cloth = Cloth.rectangle(width=0.3, height=0.2, spacing=0.05, fabric=Fabric(bend=0.01))
    mass = cloth.masses()
    weights = np.where(np.arange(cloth.vertices) < cloth.columns, 0.0, 1 / mass)
    root = np.sqrt(np.repeat(weights, 3))
    exact = math.sqrt(np.linalg.eigvalsh(root[:, None] * stiffness_matrix(cloth) * root).max())
    found = largest_frequency(springs_of(cloth), weights, cloth.positions)
    # Lanczos' method comes from below, and goes on until its square changes by 1e-4 at most.
    assert 0.999 * exact < found <= exact * (1 + 1e-9)
    assert largest_frequency(springs_of(cloth), np.zeros(cloth.vertices), cloth.positions) == 0.0


def test_no_strain_or_turn_of_springs_makes_a_frequency_larger_than_its_bound():
    cloth = Cloth.rectangle(width=0.3, height=0.2, spacing=0.05, fabric=Fabric(bend=0.01))
    springs, root = springs_of(cloth), np.sqrt(np.repeat(1 / cloth.masses(), 3))
    bound = largest_frequency(springs, 1 / cloth.masses(), None)
    rng = np.random.default_rng(2)
    reached = 0.0
    for size in (0.0, 0.3, 10.0):
        crumpled = cloth.positions + size * rng.standard_normal(cloth.positions.shape)
        matrix = stiffness_matrix(cloth, crumpled)
        exact = math.sqrt(np.linalg.eigvalsh(root[:, None] * matrix * root).max())
        # Lanczos' method comes from below.
        assert 0.999 * exact < bound
        reached = max(reached, exact)
    assert bound < 1.05 * reached
    assert bound > 1.2 * largest_frequency(springs, 1 / cloth.masses(), cloth.positions)


@given(st.floats(1, 1e5), st.floats(0, 3))
def test_the_stable_step_is_where_a_root_leaves_the_unit_circle(frequency: float, ratio: float):
    rate = 2 * ratio * frequency

    def largest_root(h: float) -> float:
        return np.abs(np.roots([1, -(2 - rate * h - (frequency * h) ** 2), 1 - rate * h])).max()

    step = stable_step(frequency, rate)
    assert largest_root(0.999 * step) <= 1 + 1e-9
    assert largest_root(1.001 * step) > 1
    assert stable_step(0.0, 0.0) == math.inf


def odd(value: Any) -> Any:
    """What a type checker would refuse."""
    return value


def test_a_property_of_the_threads_reads_back_as_it_was_given():
    alike = Fabric(stretch=1500, bend=2e-5)
    assert (alike.stretch, alike.stretch_warp, alike.stretch_weft, alike.bend) == (1500, 1500, 1500, 2e-5)
    unlike = Fabric(stretch=odd([1500, 400]), bend=odd(np.array([4e-5, 1e-5])))
    assert (unlike.stretch, unlike.bend) == ((1500.0, 400.0), (4e-5, 1e-5))
    assert all(type(value) is float for value in (*odd(unlike.stretch), *odd(unlike.bend)))
    assert (unlike.stretch_warp, unlike.stretch_weft, unlike.bend_warp, unlike.bend_weft) == (1500.0, 400.0, 4e-5, 1e-5)
    assert unlike == Fabric(stretch=(1500.0, 400.0), bend=(4e-5, 1e-5))


def test_bending_across_the_threads_is_that_of_an_orthotropic_plate():
    fabric_ = Fabric(bend=(4e-5, 1e-5))
    angle = np.linspace(0.0, np.pi, 13)
    weft, warp = np.cos(angle), np.sin(angle)
    # Curvature along the angle: both threads' own, and twist of cos sin, of the rigidity's geometric mean.
    expected = 1e-5 * weft**4 + 4e-5 * warp**4 + 2.0 * 2e-5 * (weft * warp) ** 2
    np.testing.assert_allclose(fabric_.bend_along(weft**2), expected, rtol=1e-12)
    assert fabric_.bend_bias == pytest.approx((1e-5 + 4e-5 + 2 * 2e-5) / 4.0)
    assert Fabric(bend=3e-5).bend_bias == 3e-5


# -- what is refused --


def rectangle() -> GridCloth:
    return CUTS["rectangle"]


REFUSED = {
    "width 0": (lambda: Cloth.rectangle(width=0), "width must be positive and finite, not 0"),
    "height NaN": (lambda: Cloth.rectangle(height=math.nan), "height must be positive and finite, not nan"),
    "spacing < 0": (lambda: Cloth.rectangle(spacing=-1), "spacing must be positive and finite, not -1"),
    "parallel": (lambda: Cloth.rectangle(right=(0, 0, 1)), "must not be parallel"),
    "no direction": (lambda: Cloth.rectangle(down=(0, 0, 0)), "down must be three finite numbers, not all zero"),
    "cape's length": (lambda: Cloth.cape(length=-1), "length must be positive and finite, not -1"),
    "cape's flare": (lambda: Cloth.cape(flare=1.0), "flare of a cape must be above 1 and below 20, not 1.0"),
    "cape's spacing": (lambda: Cloth.cape(spacing=0.5), "a spacing of 0.5 m is too wide for a cape"),
    "shoulders": (lambda: Cloth.cape(shoulder_width=0), "shoulder width must be positive and finite, not 0"),
    "region": (lambda: attach(rectangle(), "hand", "collar"), "no cloth region named 'collar'; available: top, bottom"),
    "index": (lambda: attach(rectangle(), "hand", [0, 40]), "vertex 40 is outside of a cloth of 40 vertices"),
    "negative index": (lambda: attach(rectangle(), "hand", [-1, 3]), "vertex -1 is outside of a cloth of 40 vertices"),
    "mask": (lambda: attach(rectangle(), "hand", np.ones(40, dtype=bool)), "by whole numbers, not by bool"),
    "fractions": (lambda: attach(rectangle(), "hand", np.array([1.5])), "by whole numbers, not by float64"),
    "no index": (lambda: attach(rectangle(), "hand", []), "no vertices given"),
    "nothing said": (lambda: attach(rectangle(), "hand"), "attach to 'hand': name the vertices, or give a distance"),
    "within 0": (lambda: attach(rectangle(), "hand", within=0), "attach to 'hand': the distance must be positive"),
    "points": (lambda: attach(rectangle(), "hand", [1, 2], points=[[0, 0, 0]]), "one for each of the 2 vertices"),
    "NaN point": (lambda: attach(rectangle(), "hand", [1], points=[[0, 0, math.nan]]), "points must be finite"),
    "density 0": (lambda: Fabric(density=0), "fabric density must be positive and finite, not 0"),
    "stretch inf": (lambda: Fabric(stretch=math.inf), "fabric stretch must be positive and finite, not inf"),
    "bend < 0": (lambda: Fabric(bend=-1), "fabric bend must be zero or more and finite, not -1"),
    "damping NaN": (lambda: Fabric(damping_time=math.nan), "fabric damping_time must be zero or more and finite"),
    "warp < 0": (lambda: Fabric(stretch=(-1, 2)), "fabric stretch must be positive and finite, not (-1.0, 2.0)"),
    "weft NaN": (lambda: Fabric(bend=(0, math.nan)), "fabric bend must be zero or more and finite, not (0.0, nan)"),
    "three threads": (lambda: Fabric(bend=odd((1, 2, 3))), "fabric bend must be one number or a pair (warp, weft)"),
    "words": (lambda: Fabric(stretch=odd(("a", "b"))), "fabric stretch must be one number or a pair (warp, weft), not"),
    "two shears": (lambda: Fabric(shear=odd((1, 2))), "fabric shear must be one number, not (1, 2)"),
    "a word": (lambda: Fabric(density=odd("heavy")), "fabric density must be one number, not 'heavy'"),
    "fabric": (lambda: fabric("silk"), "no fabric named 'silk'; available: broadcloth, cape, chiffon-weight, denim"),
    "wind": (lambda: Wind(velocity=(1, 2, math.inf)), "wind velocity must be three finite numbers"),
    "air": (lambda: Wind(density=-1), "wind density must be zero or more and finite, not -1"),
    "doubly attached": (
        lambda: Scene(rectangle(), [attach(rectangle(), "a", [1, 2]), attach(rectangle(), "b", [2])]),
        "vertex 2 is attached more than once",
    ),
    "doubly named": (lambda: Scene(rectangle(), (), [Sphere(), Sphere()]), "two colliders are named 'sphere'"),
    "sphere's radius": (lambda: Sphere(radius=0), "sphere 'sphere': the radius must be positive, not 0"),
    "sphere's centre": (lambda: Sphere(center=np.array([0, math.nan, 0])), "center must be 3 finite numbers"),
    "sphere's friction": (lambda: Sphere(friction=-1), "sphere 'sphere': friction must be zero or more, not -1"),
    "flat box": (lambda: Box(half_sizes=np.array([1, 1.0])), "box 'box': half_sizes must be 3 finite numbers"),
    "box without size": (lambda: Box(half_sizes=np.array([1, 1, 0])), "box 'box': half_sizes must be positive"),
    "box's rotation": (lambda: Box(rotation_wxyz=np.array([2.0, 0, 0, 0])), "rotation_wxyz must be of unit length"),
    "plane's normal": (lambda: Plane(normal=np.zeros(3)), "plane 'plane': the normal must not be zero"),
    "gravity": (lambda: Scene(rectangle(), gravity=(0, 0, math.nan)), "gravity must be three finite numbers"),
    "friction": (lambda: Scene(rectangle(), friction=-0.1), "friction must be zero or more and finite, not -0.1"),
    "thickness": (lambda: Scene(rectangle(), thickness=math.inf), "thickness must be zero or more and finite, not inf"),
    "substeps": (lambda: XPBD(substeps=0), "substeps must be 1 or more, not 0"),
    "precision": (lambda: XPBD(precision="half"), "precision must be single or double, not 'half'"),  # type: ignore[arg-type]
    "iterations": (lambda: XPBD(iterations=0), "iterations must be 1 or more, not 0"),
    "margin": (lambda: SymplecticEuler(margin=1.5), "margin must be above 0 and at most 1, not 1.5"),
    "solver": (lambda: solver("verlet"), "no solver named 'verlet'; available: euler, xpbd"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_bad_values_are_refused_in_one_line(case: str):
    make, text = REFUSED[case]
    with pytest.raises(UserError) as raised:
        make()
    assert text in str(raised.value)
    assert "\n" not in str(raised.value)
    assert isinstance(raised.value, (ValueRangeError, UnknownNameError))


@settings(deadline=None, max_examples=50)
@given(st.floats(0.05, 3), st.floats(1.01, 19), st.floats(0.01, 0.2), st.floats(0.1, 1))
def test_any_cape_is_a_sound_cloth_or_refused(length: float, flare: float, spacing: float, shoulder_width: float):
    try:
        cloth = Cloth.cape(length=length, flare=flare, spacing=max(spacing, length / 50), shoulder_width=shoulder_width)
    except UserError:
        return
    assert np.isfinite(cloth.positions).all()
    assert cloth.masses().min() > 0
    springs = springs_of(cloth)
    assert springs.rest.min() > 0
    assert springs.stiffness.min() > 0
    assert len(springs.first) == len(springs.second)


def test_the_largest_step_is_found_anew_only_when_stiffness_or_mass_change(monkeypatch: pytest.MonkeyPatch):
    found: list[float] = []

    def counting(*arguments) -> float:
        found.append(largest_frequency(*arguments))
        return found[-1]

    monkeypatch.setattr("cape.assembly.stability.largest_frequency", counting)
    cloth = Cloth.rectangle(width=0.31, height=0.2, spacing=0.05)
    weights = 1 / cloth.masses()
    steps = []
    for fabric_, inverse_mass in (
        (cloth.fabric, weights),
        (cloth.fabric, weights.copy()),
        (replace(cloth.fabric, stretch=2 * cloth.fabric.stretch), weights),
        (cloth.fabric, 2 * weights),
        (cloth.fabric, weights),
    ):
        springs = springs_of(replace(cloth, fabric=fabric_))
        steps.append(largest_step(springs, fabric_, inverse_mass, cloth.positions))
    assert len(found) == 3
    assert steps[0] == steps[1] == steps[4]
    assert steps[0] > steps[2]
    assert steps[0] > steps[3]


# -- attaching by distance --

POSE = {"hand": ([0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0])}


def test_within_a_distance_of_the_bone():
    cloth = rectangle()
    simulation = Simulation(Scene(cloth, [attach(cloth, "hand", within=0.15)]))
    simulation.start(POSE)
    expected = np.flatnonzero(np.linalg.norm(cloth.positions, axis=1) <= 0.15)
    assert simulation.assembly.attached is not None
    np.testing.assert_array_equal(simulation.assembly.attached.vertices, expected)
    # Three of a region of eight.
    simulation = Simulation(Scene(cloth, [attach(cloth, "hand", "top", within=0.25)]))
    simulation.start(POSE)
    assert simulation.assembly.attached is not None
    np.testing.assert_array_equal(simulation.assembly.attached.vertices, [0, 1, 2])


def test_within_reach_of_nothing():
    cloth = rectangle()
    simulation = Simulation(Scene(cloth, [attach(cloth, "hand", "bottom", within=0.2)]))
    with pytest.raises(ValueRangeError, match=r"within 0.2 m of 'hand'; the closest is 0.400 m off"):
        simulation.start(POSE)


def test_no_vertex_is_held_by_two_bones():
    cloth = rectangle()
    both = Scene(cloth, [attach(cloth, "hand", within=0.15), attach(cloth, "foot", within=0.15)])
    with pytest.raises(ValueRangeError, match="vertex 0 is attached more than once"):
        Simulation(both).start({**POSE, "foot": POSE["hand"]})
