"""The fit of slopes across edges, against numpy and against quadratics."""

import numpy as np

import cape
from cape.assembly.mesh import curvature
from cape.cloth.triangle_mesh import edges_of
from cape.kernels.cloth import fit, slopes
from tests.tearing.to_tear import mesh_of

MESH = mesh_of(cape.Cloth.rectangle(width=0.4, height=0.5, spacing=0.05), jitter=0.012)


def normal_matrices() -> list[np.ndarray]:
    """Of random points, of points on a line, and a diagonal one."""
    rng, found = np.random.default_rng(2), [np.diag([3.0, 1.0, 2.0, 5.0, 1e-3, 0.0])]
    for along in (np.ones(9), np.zeros(9)):
        x, y = rng.uniform(-1.5, 1.5, (2, 9)) * [np.ones(9), along]
        basis = np.stack([np.ones(9), x, y, x * x / 2.0, x * y, y * y / 2.0])
        found.append(basis @ basis.T)
    return found


def test_extreme_eigenvalues_are_those_of_numpy():
    for matrix in normal_matrices():
        wanted = np.linalg.eigvalsh(matrix)
        found = fit.eigenvalues(np.tril(matrix))
        np.testing.assert_allclose(found, wanted[[0, -1]], rtol=1e-12, atol=1e-14 * wanted[-1])


def test_equations_are_solved_as_numpy_does():
    matrix = normal_matrices()[1]
    factor, found = np.tril(matrix), np.arange(6.0)
    fit.factorise(factor)
    fit.solve(factor, found)
    np.testing.assert_allclose(matrix @ found, np.arange(6.0), atol=1e-10)


def first_sides(unfolded: curvature.Unfolded) -> np.ndarray:
    """The first side of each edge."""
    sides, of = np.zeros(3 * len(MESH.faces), np.int64), np.zeros((len(MESH.faces), 3), np.int64)
    number = np.full(sides.size, -1)
    count = slopes.number_sides(curvature.flat_of(MESH, unfolded), np.arange(len(of)), number, sides, of)
    assert (number == -1).all()
    wanted = edges_of(MESH.faces)
    assert count == len(np.unique(np.sort(MESH.faces[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2), axis=0))
    assert (np.isin(wanted.sides[:, 0], sides[:count])).all()
    return sides[:count]


def test_slopes_are_exact_for_quadratics_also_at_borders():
    u, v = MESH.pattern.T
    first, second = MESH.corners[:, 1] - MESH.corners[:, 0], MESH.corners[:, 2] - MESH.corners[:, 0]
    unfolded = curvature.unfold(MESH, edges_of(MESH.faces))
    sides = first_sides(unfolded)
    fitted = curvature._slopes(MESH, unfolded, sides)
    t, c = np.divmod(sides, 3)
    start, end = MESH.corners[t, c], MESH.corners[t, (c + 1) % 3]
    (mu, mv), (du, dv) = (0.5 * (start + end)).T, (end - start).T
    clockwise = np.sign(first[t, 0] * second[t, 1] - first[t, 1] * second[t, 0])
    outward = clockwise * np.stack([dv, -du]) / np.hypot(du, dv)
    heights = 0.3 + 0.7 * u - 0.2 * v + 1.1 * u * u - 0.6 * u * v + 0.9 * v * v
    gradient = np.stack([0.7 + 2.2 * mu - 0.6 * mv, -0.2 - 0.6 * mu + 1.8 * mv])
    found = (fitted.coefficients * heights[fitted.vertices]).sum(axis=1)
    np.testing.assert_allclose(found, (gradient * outward).sum(axis=0), atol=1e-10)


def test_what_needs_more_room_is_told():
    unfolded = curvature.unfold(MESH, edges_of(MESH.faces))
    flat = slopes.Flat(MESH.faces, MESH.corners, *unfolded)
    sides = first_sides(unfolded)

    def fitted(room: int) -> tuple[int, np.ndarray]:
        patch = slopes.Patch.room(len(MESH.faces), MESH.vertices)
        vertices, coefficients = np.full((len(sides), room), -1), np.zeros((len(sides), room))
        widest = slopes.fit_slopes(flat, patch, sides, curvature.FALL // 2, vertices, coefficients)
        return widest, (vertices == -1).all(axis=1)

    widest, missing = fitted(slopes.USUAL)
    assert widest > slopes.USUAL
    assert 0 < missing.sum() < len(sides)
    assert fitted(widest)[0] == widest
    assert not fitted(widest)[1].any()


def test_what_curvatures_are_made_of_is_summed_by_vertex():
    rng = np.random.default_rng(3)
    vertices, coefficients = rng.integers(0, 12, (9, 4)), rng.normal(size=(9, 4))
    coefficients[:, 3] = 0.0
    edges, faces = rng.integers(0, 9, (6, 3)), np.array([rng.permutation(12)[:3] for _ in range(6)])
    across, ends = rng.normal(size=(2, 6, 3, 3))
    across[1] = ends[1] = 0.0
    wanted = np.zeros((6, 3, 12))
    for t in range(6):
        for k in range(3):
            for vertex, coefficient in zip(vertices[edges[t, k]], coefficients[edges[t, k]], strict=True):
                wanted[t, :, vertex] += coefficient * across[t, k]
            wanted[t, :, faces[t, k]] -= ends[t, k]
            wanted[t, :, faces[t, (k + 1) % 3]] += ends[t, k]
    members, rows, place = np.zeros((6, 15), np.int64), np.zeros((6, 3, 15)), np.full(12, -1)
    widest = slopes.gather(vertices, coefficients, edges, across, ends, faces, place, members, rows)
    found, counts = np.zeros((6, 3, 12)), (rows != 0.0).any(axis=1).sum(axis=1)
    for t in range(6):
        np.add.at(found[t].T, members[t], rows[t].T)
        assert (np.diff(members[t, : counts[t]]) > 0).all()
        assert (members[t, counts[t] :] == faces[t, 0]).all()
    np.testing.assert_allclose(found, wanted, atol=1e-12)
    assert widest == counts.max()
    assert counts[1] == 0
