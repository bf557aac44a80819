"""Kernels of self-contact against plain formulas and brute force, without any of the package's objects.

They also run with the compiler off: NUMBA_DISABLE_JIT=1.
"""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from cape.assembly.self_contact import (
    _neighbors,
    cut_into_patches,
    enlarged,
    keep,
    layers_of,
    put_back,
    surplus,
    with_room_for,
)
from cape.cloth.cloth import Cloth, MeshCloth
from cape.kernels.linking import Linker
from cape.kernels.program import Use
from cape.kernels.self_contact import closest, near_pairs, patches, self_contact, tree
from cape.kernels.state import State
from cape.kernels.team import Team
from cape.scene.scene import Scene
from cape.scene.self_contact import SelfContact

FloatArray = NDArray[np.float64]

# A few dozen operations on numbers near one.
ROUNDING = 1e-12
# A triangle whose angle has a squared sine below `closest.FLAT` is its edges: they miss at most that share of its size.
FLATNESS = closest.FLAT**0.5

coordinate = st.floats(-1.0, 1.0, width=32)
point = st.tuples(coordinate, coordinate, coordinate).map(np.array)
share = st.sampled_from([0.0, 1.0, 0.5, -1.0, 1e-3])


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(5)


def to_segment(p: NDArray[np.floating], a: NDArray[np.floating], b: NDArray[np.floating]) -> float:
    """Distance of a point from a segment."""
    along = b - a
    t = np.clip((p - a) @ along / (along @ along), 0.0, 1.0) if along @ along > 0.0 else 0.0
    return float(np.linalg.norm(p - a - t * along))


def to_triangle(p: NDArray[np.floating], corners: NDArray[np.floating]) -> float:
    """Distance of a point from a triangle: from its plane where it is over the inside, else from its edges."""
    a, b, c = corners
    weights, *_ = np.linalg.lstsq(np.stack([b - a, c - a], axis=1), p - a, rcond=None)
    foot = a + weights[0] * (b - a) + weights[1] * (c - a)
    distances = [to_segment(p, a, b), to_segment(p, b, c), to_segment(p, c, a)]
    if weights.min() >= 0.0 and weights.sum() <= 1.0:
        distances.append(float(np.linalg.norm(p - foot)))
    return min(distances)


def between_segments(
    a: NDArray[np.floating], b: NDArray[np.floating], c: NDArray[np.floating], d: NDArray[np.floating]
) -> float:
    """Distance of two segments: between their insides, or of an end from the other."""
    weights, *_ = np.linalg.lstsq(np.stack([b - a, c - d], axis=1), c - a, rcond=None)
    distances = [to_segment(a, c, d), to_segment(b, c, d), to_segment(c, a, b), to_segment(d, a, b)]
    if weights.min() >= 0.0 and weights.max() <= 1.0:
        distances.append(float(np.linalg.norm(a + weights[0] * (b - a) - c - weights[1] * (d - c))))
    return min(distances)


def triangle_distance(p: FloatArray, corners: FloatArray) -> tuple[float, FloatArray, bool]:
    """Distance, corners' weights and whether the point is over the inside, by the kernel."""
    x, y, z = np.vstack([p, corners]).T
    *g, wa, wb, wc, over = closest.from_triangle(0, 1, 2, 3, x, y, z)
    np.testing.assert_allclose(g, p - np.array([wa, wb, wc]) @ corners, atol=ROUNDING)
    return float(np.linalg.norm(g)), np.array([wa, wb, wc]), over


def segment_distance(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray) -> tuple[float, float, float, bool]:
    """Distance, shares and whether the segments cross, by the kernel."""
    *g, s, t, crossing = closest.from_edge(0, 1, 2, 3, *np.stack([a, b, c, d], axis=1))
    np.testing.assert_allclose(g, a + s * (b - a) - c - t * (d - c), atol=ROUNDING)
    return float(np.linalg.norm(g)), s, t, crossing


@settings(max_examples=300, deadline=None)
@given(point, point, point, point)
def test_no_point_of_a_triangle_is_closer(p: FloatArray, a: FloatArray, b: FloatArray, c: FloatArray):
    distance, weights, _ = triangle_distance(p, np.stack([a, b, c]))
    assert abs(distance - to_triangle(p, np.stack([a, b, c]))) <= 4.0 * FLATNESS
    assert weights.min() >= -ROUNDING
    assert abs(weights.sum() - 1.0) <= ROUNDING


@settings(max_examples=200, deadline=None)
@given(point, point, point, share)
def test_a_triangle_without_area_is_its_edges(p: FloatArray, a: FloatArray, b: FloatArray, t: float):
    corners = np.stack([a, b, a + t * (b - a)])
    assert abs(triangle_distance(p, corners)[0] - to_triangle(p, corners)) <= 4.0 * FLATNESS


reach = st.floats(0.0, 2.0)


@settings(max_examples=300, deadline=None)
@given(point, point, point, point, reach)
def test_what_is_told_to_be_beyond_reach_is(p: FloatArray, a: FloatArray, b: FloatArray, c: FloatArray, most: float):
    if closest.is_beyond_triangle(0, 1, 2, 3, *np.stack([p, a, b, c], axis=1), most):
        assert to_triangle(p, np.stack([a, b, c])) >= most - 4.0 * FLATNESS
    if closest.is_beyond_edge(0, 1, 2, 3, *np.stack([p, a, b, c], axis=1), most):
        assert between_segments(p, a, b, c) >= most - 4.0 * FLATNESS


def test_most_of_what_is_beyond_reach_is_told_to_be(rng: np.random.Generator):
    """Two edges or a triangle as long as the reach, three times as far off: as seen from afar, more than the reach."""
    for _ in range(200):
        corners = rng.uniform(-0.5, 0.5, (4, 3)) / np.sqrt(3.0)
        away = rng.standard_normal(3)
        away *= 3.0 / np.linalg.norm(away)
        assert closest.is_beyond_triangle(0, 1, 2, 3, *(corners + away * np.array([[1], [0], [0], [0]])).T, 1.0)
        assert closest.is_beyond_edge(0, 1, 2, 3, *(corners + away * np.array([[1], [1], [0], [0]])).T, 1.0)


@pytest.mark.parametrize("triangles", [1, 16, 17, 500])
def test_a_tree_finds_the_pairs_of_leaves_whose_boxes_overlap(rng: np.random.Generator, triangles: int):
    middles = rng.uniform(size=(3 * triangles, 3))
    cut, branched = cut_into_patches(np.arange(3 * triangles).reshape(-1, 3), middles)
    leaves = len(cut.triangle_start) - 1
    low = middles[cut.triangles.T].mean(axis=1)
    boxes = np.concatenate([low, low + 0.02 * rng.uniform(size=(triangles, 3))], axis=1)
    tree.set_boxes(branched, cut.triangle_start, np.ascontiguousarray(boxes.T))
    found, waiting = [], 1
    branched.waiting[0] = 0
    while True:
        a, b, waiting = tree.next_pair(branched, waiting)
        if a < 0:
            break
        found.append((int(branched.first[a]), int(branched.first[b])))
    parts = np.split(boxes, cut.triangle_start[1:-1])
    of_leaves = np.stack([np.concatenate([part[:, :3].min(axis=0), part[:, 3:].max(axis=0)]) for part in parts])
    reaches = (of_leaves[:, None, :3] < of_leaves[None, :, 3:]).all(axis=2)
    overlap = np.logical_and(reaches, reaches.T)
    expected = {(a, b) for a in range(leaves) for b in range(a, leaves) if a == b or overlap[a, b]}
    assert sorted(found) == sorted(expected)


@given(st.integers(1, 40), st.integers(1, 12), st.integers(0, 80), st.integers(0, 2**32 - 1))
def test_neighbouring_patches_are_those_that_share_a_vertex(vertices: int, pieces: int, count: int, seed: int):
    rng = np.random.default_rng(seed)
    triangles, owner = rng.integers(0, vertices, (count, 3)), np.sort(rng.integers(0, pieces, count))
    own = [set(triangles[owner == p].ravel().tolist()) for p in range(pieces)]
    shared = [[a, b] for a in range(pieces) for b in range(pieces) if a != b and own[a] & own[b]]
    assert _neighbors(triangles.astype(np.uint32), owner).tolist() == shared


def test_a_point_over_a_triangle_is_told_from_one_beside_it():
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    for p, weights, over in (
        ((0.25, 0.25, -2.0), (0.5, 0.25, 0.25), True),
        ((0.5, -1.0, 0.0), (0.5, 0.5, 0.0), False),
        ((2.0, 2.0, 1.0), (0.0, 0.5, 0.5), False),
        ((-1.0, -1.0, 3.0), (1.0, 0.0, 0.0), False),
    ):
        _, found, is_over = triangle_distance(np.array(p), corners)
        np.testing.assert_allclose(found, weights, atol=ROUNDING)
        assert is_over == over


@settings(max_examples=300, deadline=None)
@given(point, point, point, point)
def test_no_points_of_two_segments_are_closer(a: FloatArray, b: FloatArray, c: FloatArray, d: FloatArray):
    distance, s, t, _ = segment_distance(a, b, c, d)
    assert abs(distance - between_segments(a, b, c, d)) <= 4.0 * FLATNESS
    assert 0.0 <= s <= 1.0
    assert 0.0 <= t <= 1.0


@settings(max_examples=200, deadline=None)
@given(point, point, point, share, st.booleans())
def test_parallel_segments_and_those_without_length(
    a: FloatArray, b: FloatArray, c: FloatArray, t: float, is_point: bool
):
    d = c if is_point else c + t * (b - a)
    distance, *_, crossing = segment_distance(a, b, c, d)
    assert abs(distance - between_segments(a, b, c, d)) <= 4.0 * FLATNESS
    assert not crossing
    assert abs(segment_distance(c, d, a, b)[0] - distance) <= 4.0 * FLATNESS


def test_segments_that_cross_are_told_from_others():
    x, y, up = np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0]), np.array([0.0, 0.0, 0.3])
    assert segment_distance(-x, x, up - y, up + y) == (0.3, 0.5, 0.5, True)
    assert not segment_distance(-x, x, up + 2 * y, up + 3 * y)[3]


def shaken(rng: np.random.Generator, *, rows: int = 7, columns: int = 9, noise: float = 0.04) -> tuple[Cloth, State]:
    """A cloth so crumpled that no patch of it is calm, at random velocities."""
    cloth = Cloth.rectangle(width=0.04 * (columns - 1), height=0.04 * (rows - 1), spacing=0.04)
    p = cloth.positions + rng.normal(0.0, noise, cloth.positions.shape)
    return cloth, State(*p.T.copy(), *rng.normal(0.0, 1.0, p.T.shape))


def record(cloth: Cloth, *, thickness: float | None = None, friction: float = 0.0) -> self_contact.Layers:
    scene = Scene(cloth, self_contact=SelfContact(thickness=thickness, friction=friction))
    made = layers_of(scene, cloth, alarm=np.zeros(1, np.int64), spreads=np.zeros((1, 3)))
    assert made is not None
    return made


def search(
    layers: self_contact.Layers,
    s: State,
    inverse_mass: NDArray[np.float64],
    *,
    reach: float,
    nearest: float,
    ahead: float,
) -> None:
    """List the pairs that may come within `reach` [m] of each other, but for those that are nearer at rest."""
    patches.look(s, ahead, ahead, layers.sight.places)
    near_pairs.search(layers._replace(thickness=nearest, margin=reach - nearest), inverse_mass)


def listed(pairs: near_pairs.Pairs) -> set[tuple[int, int]]:
    n = pairs.counts[0]
    return set(zip(pairs.first[:n].tolist(), pairs.second[:n].tolist(), strict=True))


def test_the_search_finds_what_brute_force_finds(rng: np.random.Generator):
    cloth, s = shaken(rng, rows=5, columns=7, noise=0.08)
    contact = record(cloth, thickness=0.012)
    inverse_mass = (rng.uniform(size=cloth.vertices) < 0.6).astype(float)
    cut, reach, ahead = contact.patches, 0.03, 0.02
    search(contact, s, inverse_mass, reach=reach, nearest=0.012, ahead=ahead)
    p, v, rest = np.stack(s[:3], axis=1), np.stack(s[3:], axis=1), cut.rest.T
    triangles, edges = cut.triangles.T.astype(int), cut.edges.T.astype(int)
    assert sorted(map(sorted, triangles.tolist())) == sorted(map(sorted, cloth.triangles.tolist()))

    def nearest(mine: tuple[int, ...], theirs: tuple[int, ...]) -> tuple[float, float]:
        """Least distance on the way, and what the search may go by: that now, less what they can come nearer."""

        def distance(q: NDArray[np.floating]) -> float:
            if len(mine) == 1:
                return to_triangle(q[mine[0]], q[list(theirs)])
            return between_segments(q[mine[0]], q[mine[1]], q[theirs[0]], q[theirs[1]])

        speed = max(float(np.linalg.norm(v[i] - v[j])) for i in mine for j in theirs)
        if distance(p) > reach + ahead * speed or distance(rest) < 0.012 or not inverse_mass[[*mine, *theirs]].any():
            return np.inf, np.inf
        return min(distance(p + share * ahead * v) for share in (0.0, 0.5, 1.0)), distance(p) - ahead * speed

    faces = {
        (i, t): nearest((i,), tuple(corners))
        for i in range(cloth.vertices)
        for t, corners in enumerate(triangles)
        if i not in corners
    }
    crossed = {
        (e, f): nearest(tuple(edges[e]), tuple(edges[f]))
        for e in range(len(edges))
        for f in range(e)
        if len({*edges[e], *edges[f]}) == 4
    }
    for found, pairs in ((listed(contact.faces), faces), (_descending(listed(contact.edges)), crossed)):
        assert {pair for pair, (least, _) in pairs.items() if least <= reach} <= found
        assert found <= {pair for pair, (_, bound) in pairs.items() if bound <= reach}
        assert 50 < len(found) < len(pairs) / 2
    assert len(listed(contact.edges)) == contact.edges.counts[0]


def _descending(pairs: set[tuple[int, int]]) -> set[tuple[int, int]]:
    return {(max(pair), min(pair)) for pair in pairs}


def test_a_cloth_that_is_nowhere_sharply_folded_is_not_looked_into():
    cloth = Cloth.rectangle(width=1.0, height=1.0, spacing=0.05)
    p = cloth.positions.copy()
    p[:, 0] += 0.1 * np.sin(6.0 * p[:, 2])
    s = State(*p.T.copy(), *np.zeros(p.T.shape))
    contact = record(cloth)
    search(contact, s, np.ones(cloth.vertices), reach=0.03, nearest=0.005, ahead=0.0)
    assert contact.faces.counts[0] == contact.edges.counts[0] == 0


def test_two_layers_are_found_wherever_they_lie(rng: np.random.Generator):
    cloth = folded_flat(0.01)
    for shift in rng.uniform(-50.0, 50.0, (3, 3)):
        s = State(*(cloth.positions + shift).T.copy(), *np.zeros(cloth.positions.T.shape))
        contact = record(cloth, thickness=0.005)
        search(contact, s, np.ones(cloth.vertices), reach=0.0101, nearest=0.005, ahead=0.0)
        over = {i for i, _ in listed(contact.faces)}
        assert over == set(range(cloth.vertices))


def folded_flat(gap: float) -> MeshCloth:
    """Two parallel sheets that aren't connected."""
    sheet = Cloth.rectangle(width=0.3, height=0.3, spacing=0.05, down=(1.0, 0.0, 0.0))
    n = sheet.vertices
    return Cloth.from_mesh(
        np.concatenate([sheet.positions, sheet.positions + np.array([0.0, 0.0, gap])]),
        np.concatenate([sheet.triangles, sheet.triangles + n]),
    )


def test_what_strays_from_where_it_was_foreseen(rng: np.random.Generator):
    n, ahead, limit = 64, 0.01, 0.02
    s = State(*rng.uniform(-1.0, 1.0, (6, n)))
    places = np.zeros((6, n))
    patches.look(s, 0.03, 0.03, places)
    for later in (0.0, 0.02):
        moved = State(*np.concatenate([np.stack(s[:3]) + later * np.stack(s[3:]) + 7.0, s[3:]]))
        assert patches.is_foreseen(moved, places, ahead, limit)
    # Beyond the horizon they stray by what they have gone on since then, apart from the drift.
    beyond = State(*np.concatenate([np.stack(s[:3]) + 0.05 * np.stack(s[3:]), s[3:]]))
    assert not patches.is_foreseen(beyond, places, ahead, limit)
    aside = State(*(a.copy() for a in s))
    aside.x[5] += 0.025
    assert not patches.is_foreseen(aside, places, 0.0, limit)
    assert not patches.is_foreseen(s, np.full((6, n), np.nan), ahead, limit)


def test_fast_vertices_are_foreseen_for_a_short_way_only(rng: np.random.Generator):
    n, least, ahead = 64, 0.002, 0.01
    s = State(*rng.uniform(-1.0, 1.0, (6, n)))
    for component in s[3:]:
        component *= np.geomspace(1e-3, 1e2, n)
    places = np.zeros((6, n))
    patches.look(s, least, ahead, places)
    speed = np.linalg.norm([component - component[:: patches.SAMPLE].mean() for component in s[3:]], axis=0)
    way = np.linalg.norm(places[3:], axis=0)
    np.testing.assert_allclose(way, np.maximum(np.minimum(speed * ahead, patches.FAR), speed * least), rtol=1e-12)
    assert (way < speed * ahead).any()
    assert (way > patches.FAR).any()


def test_a_pair_remembers_its_side():
    thickness, apart = 0.005, np.zeros((1, 3), np.float32)
    above = self_contact.depth_of(0, apart, 0.0, 0.0, 0.004, thickness, True)
    np.testing.assert_allclose(above, (0.001, 0.0, 0.0, 1.0), atol=ROUNDING)
    # It has passed through: back by what it is below, and the thickness.
    below = self_contact.depth_of(0, apart, 0.0, 0.0, -0.003, thickness, True)
    np.testing.assert_allclose(below, (0.008, 0.0, 0.0, 1.0), atol=ROUNDING)
    touching = self_contact.depth_of(0, apart, 0.0, 0.0, 0.0, thickness, True)
    np.testing.assert_allclose(touching, (thickness, 0.0, 0.0, 1.0), atol=ROUNDING)
    # It has gone around: far enough, beside the triangle.
    around = self_contact.depth_of(0, apart, 0.0, 0.0, -0.004, thickness, False)
    np.testing.assert_allclose(around, (0.001, 0.0, 0.0, -1.0), atol=ROUNDING)


WEIGHTS = (1.0, -0.5, -0.3, -0.2)
THICKNESS = 0.005


def pushed(
    p: FloatArray, v: FloatArray, depth: float, n: FloatArray, friction: float, step: float, w: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Positions and velocities (4, 3) after a contact without a held force, as the module's text says it."""
    weights = np.array(WEIGHTS)
    mobility = weights**2 @ w
    relative = weights @ v
    into = max(-relative @ n, 0.0)
    impulse = into * n
    if friction:
        sliding = relative - (relative @ n) * n
        speed = np.linalg.norm(sliding)
        impulse = impulse - min(1.0, friction * into / speed) * sliding
    again = min(step, depth / into) if into > 0.0 else 0.0
    rest = depth - again * into
    # At once what lacks more than 0.9 of the thickness, but 0.3 of it at most; the rest as it goes.
    through = min(max(rest - 0.9 * THICKNESS, 0.0), 0.3 * THICKNESS)
    deep = max(rest - 0.5 * THICKNESS, 0.0)
    rest = through + (deep - through) * step / 20e-3 + (rest - deep) * step / 0.3
    shares = (weights * w)[:, None] / mobility
    return p + shares * (again * impulse + rest * n), v + shares * impulse


@pytest.mark.parametrize("friction", [0.0, 0.3, 5.0])
def test_response_to_a_contact(rng: np.random.Generator, friction: float):
    step = 0.001
    for _ in range(20):
        p, v = rng.standard_normal((2, 4, 3))
        n = rng.standard_normal(3)
        n /= np.linalg.norm(n)
        depth, w = rng.uniform(0.0, 0.01), rng.uniform(0.0, 2.0, 4)
        x, u, held = p.T.copy(), v.T.copy(), np.zeros((3, 4))
        self_contact.push(
            0,
            0,
            1,
            2,
            3,
            *WEIGHTS,
            depth,
            self_contact.SLACK * THICKNESS,
            *n,
            np.zeros((1, 3)),
            friction,
            step,
            step,
            False,
            w,
            *x,
            *u,
            held,
        )
        expected = pushed(p, v, depth, n, friction, step, w)
        np.testing.assert_allclose(x.T, expected[0], atol=ROUNDING)
        np.testing.assert_allclose(u.T, expected[1], atol=ROUNDING)
        np.testing.assert_allclose((u - v.T) @ (1.0 / w), 0.0, atol=1e-9)
        np.testing.assert_array_equal(held, 0.0)


@pytest.mark.parametrize("friction", [0.2, 2.0])
def test_a_held_force_does_what_impulses_had_to_do(friction: float):
    """Under a steady load the force grows, beat by beat, to what the load needs; then there are no impulses."""
    w, step, load, force, slack = np.ones(4), 1e-3, np.array([0.5, 0.0, -9.81]), np.zeros((1, 3)), 1e-4
    x, u, n = np.zeros((3, 4)), np.zeros((3, 4)), np.array([0.0, 0.0, 1.0])
    weights = np.array(WEIGHTS)
    impulse, held = 0.0, np.zeros((3, 4))
    for _ in range(2000):
        held[:] = 0.0
        relative = u @ weights
        self_contact.push(0, 0, 1, 2, 3, *WEIGHTS, 0.0, slack, *n, force, friction, step, step, True, w, *x, *u, held)
        impulse = np.linalg.norm(u @ weights - relative)
        # The load acts on the first vertex, the other three are pushed by the force alone.
        u[:, 0] += step * load
        u += step * held
    mobility = weights @ weights
    need = -load[2] / mobility
    np.testing.assert_allclose(force[0, 2], need, rtol=1e-9)
    np.testing.assert_allclose(force[0, 0], -min(load[0] / mobility, friction * need), rtol=1e-9)
    np.testing.assert_allclose(held, np.outer(force[0], weights), atol=1e-9)
    assert impulse < 1e-12
    assert abs((u @ weights)[2]) < 1e-12


def test_attached_vertices_alone_are_not_pushed():
    x, u, held = np.zeros((3, 4)), np.ones((3, 4)), np.zeros((3, 4))
    u[2, 0] = -5.0
    self_contact.push(
        0, 0, 1, 2, 3, *WEIGHTS, 0.1, 1e-4, 0.0, 0.0, 1.0, np.zeros((1, 3)), 0.3, 1e-3, 1e-3, True, np.zeros(4),
        *x, *u, held,
    )  # fmt: skip
    assert not x.any()
    assert not held.any()


@pytest.mark.parametrize("share", [0.9, 0.5, 0.02, 1e-4])
def test_what_is_free_is_not_thrown_far_for_the_sake_of_attached_ones(share: float):
    """A vertex that is carried at 1 m/s towards a triangle of which one corner is free, and close to which it isn't."""
    weights = (1.0, -share, -(1.0 - share) / 2.0, -(1.0 - share) / 2.0)
    inverse_mass = np.array([0.0, 4e3, 0.0, 0.0])
    x, v = np.zeros((3, 4)), np.zeros((3, 4))
    v[2, 0], step, force, held = -1.0, 1e-4, np.zeros((1, 3)), np.zeros((3, 4))
    for _ in range(50):
        free, came = v[2, 1], v[2, 0] - share * v[2, 1]
        self_contact.push(
            0, 0, 1, 2, 3, *weights, 1e-3, 1e-4, 0.0, 0.0, 1.0, force, 0.0, step, step, True, inverse_mass, *x, *v, held
        )
        # Stopped as far as leverage goes, and never thrown further than that.
        thrown = min(1.0 / share, 2.0) * abs(came)
        np.testing.assert_allclose(v[2, 1] - free, -thrown if came < 0.0 else 0.0, rtol=1e-9, atol=1e-12)
        v[2, 1] = 0.0
        # What is held goes on as a force of no more than a part of that for each beat.
        assert abs(held[2, 1]) * step <= 100.0 * abs(came)
        held[:] = 0.0


def crumple(contact: self_contact.Layers, s: State, frames: int) -> None:
    """Let a cloth go on without springs, kept apart."""
    step, inverse_mass = 2e-4, np.full(s.x.size, 2e3)
    for _ in range(frames):
        for substep in range(10):
            for position, velocity in zip(s[:3], s[3:], strict=True):
                position += step * velocity
            self_contact.press(self_contact.Pressed(s, contact.pressure), Team.alone(s.x.size), substep, 10, step)
            keep_apart(s, contact, inverse_mass, substep, 10, step)


def keep_apart(
    s: State, layers: self_contact.Layers, inverse_mass: NDArray[np.float64], substep: int, substeps: int, step: float
) -> None:
    """Keep layers apart in one of a frame's substeps."""
    linker = Linker()
    look = Use(self_contact.look_ahead, self_contact.Ahead(s, layers.sight.places, layers.pressure.clock))
    search = linker.program([look, Use(self_contact.search_pairs, self_contact.Searched(layers, inverse_mass))])
    linker.link()
    group = self_contact.Layered(s, layers, inverse_mass, search)
    self_contact.keep_apart(group, Team.alone(s.x.size), substep, substeps, step)


@pytest.mark.parametrize(("turns", "ahead"), [(False, self_contact.HORIZON), (True, 2e-3)])
def test_cloth_is_foreseen_for_as_long_as_lists_serve(rng: np.random.Generator, turns: bool, ahead: float):
    """Vertices that go on are foreseen far ahead; those that turn round all the time, for two looks at them."""
    cloth, start = shaken(rng, noise=0.01)
    contact, s = record(cloth), State(*(a.copy() for a in start))
    step, inverse_mass = 2e-4, np.zeros(s.x.size)
    s.vz[:] = rng.uniform(-8.0, 8.0, s.x.size) if turns else 0.5 * np.sin(np.arange(s.x.size))
    for k in range(200):
        s.z[:] += step * s.vz
        if turns and k % 5 == 0:
            s.vz[:] *= -1.0
        keep_apart(s, contact, inverse_mass, k, 200, step)
    places = contact.sight.places
    fastest = np.argmax(np.abs(s.vz))
    mean = s.vz[:: patches.SAMPLE].mean()
    assert abs(places[5, fastest] / (s.vz[fastest] - mean)) == pytest.approx(ahead, rel=1e-6)


def test_cloth_that_goes_on_evenly_is_soon_foreseen_far_ahead_again(rng: np.random.Generator):
    """However fast: lists that served for a single look don't keep those after them from serving longer."""
    cloth, start = shaken(rng, noise=0.01)
    contact, s = record(cloth), State(*(a.copy() for a in start))
    step, every, looks = 2e-4, 5, 30
    s.vz[:] = rng.choice([-1.0, 1.0], s.x.size) * 0.6 * contact.margin / (every * step)
    assert np.abs(s.vz).max() * self_contact.HORIZON < patches.FAR
    for k in range(every * looks):
        s.z[:] += step * s.vz
        if k < every * 3 and k % every == 0:
            s.vz[:] *= -1.0
        keep_apart(s, contact, np.zeros(s.x.size), k, every * looks, step)
    # Lists that serve for a look, two, three and so on, up to the horizon of 6: half as many as looks would be plenty.
    assert contact.pressure.clock[self_contact.SEARCHES] <= looks // 2


def test_runs_repeat_to_the_last_bit_also_after_going_back(rng: np.random.Generator):
    cloth, start = shaken(rng, noise=0.01)
    contact, s = record(cloth, friction=0.3), State(*(a.copy() for a in start))
    crumple(contact, s, 3)
    middle, known = np.stack(s), keep(contact)
    crumple(contact, s, 3)
    end = np.stack(s)
    again, fresh = State(*(a.copy() for a in start)), record(cloth, friction=0.3)
    crumple(fresh, again, 6)
    np.testing.assert_array_equal(np.stack(again), end)
    put_back(contact, known)
    for a, b in zip(s, middle, strict=True):
        a[:] = b
    crumple(contact, s, 3)
    np.testing.assert_array_equal(np.stack(s), end)
    assert not np.array_equal(middle, end)


def test_what_is_known_finds_room_in_another_cloth_that_had_less(rng: np.random.Generator):
    cloth, s = shaken(rng, noise=0.01)
    contact, other = record(cloth, friction=0.3), record(cloth, friction=0.3)
    crumple(contact, s, 3)
    known = keep(contact)
    faces, edges = (
        p._replace(**{f: getattr(p, f)[:4] for f in p._fields if f not in ("counts", "head")})
        for p in (other.faces, other.edges)
    )
    roomy = with_room_for(other._replace(faces=faces, edges=edges), known)
    assert min(len(roomy.faces.first), len(roomy.edges.first)) > 4
    assert with_room_for(roomy, known) is roomy
    put_back(roomy, known)
    np.testing.assert_equal(keep(roomy), known)


def test_a_cloth_that_does_not_touch_itself_is_left_alone():
    cloth = Cloth.rectangle(width=0.5, height=0.5, spacing=0.05)
    s = State(*cloth.positions.T.copy(), *np.zeros(cloth.positions.T.shape))
    s.vy[:] = 3.0
    alone = State(*(a.copy() for a in s))
    contact = record(cloth, friction=0.3)
    crumple(contact, s, 2)
    for _ in range(20):
        for position, velocity in zip(alone[:3], alone[3:], strict=True):
            position += 2e-4 * velocity
    np.testing.assert_array_equal(np.stack(s), np.stack(alone))


def test_pairs_without_room_are_counted_and_found_with_more(rng: np.random.Generator):
    cloth, s = shaken(rng, noise=0.03)
    full = record(cloth)
    inverse_mass = np.ones(cloth.vertices)
    keep_apart(State(*(a.copy() for a in s)), full, inverse_mass, 0, 1, 1e-4)
    short = record(cloth)
    faces = short.faces
    narrow = faces._replace(**{f: getattr(faces, f)[:10] for f in faces._fields if f not in ("counts", "head")})
    short = short._replace(faces=narrow)
    state = State(*(a.copy() for a in s))
    keep_apart(state, short, inverse_mass, 0, 1, 1e-4)
    assert surplus(full) == 0
    assert surplus(short) > 0
    while surplus(short):
        short = enlarged(short)
        keep_apart(state, short, inverse_mass, 0, 1, 1e-4)
    assert short.faces.counts[0] > 10
