"""Takes baked to joints, read back by a reader that knows nothing of how they were written."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.optimize import nnls
from scipy.spatial.transform import Rotation

from cape.exports.moving_mesh import moving_mesh
from cape.exports.skinned import glb
from cape.exports.skinned.blending import blend
from cape.exports.skinned.candidates import Candidates
from cape.exports.skinned.fit import fit
from cape.exports.skinned.joint_motions import fit_motions
from cape.exports.skinned.joints import Joints, spread
from cape.exports.skinned.rotations import nearest_rotations
from motions import quaternions
from motions.errors import UserError
from tests.exports.a_take import FPS, FRAMES, make_take
from tests.exports.skinned_reader import read
from tests.support.command import Forks

WITHIN = 1e-5  # m
TURN = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])  # Z up to Y up


def waving():
    """A take whose cloth waves, as far as few joints can follow."""
    take = make_take()
    rest, times = take.positions[0].astype(float), np.arange(FRAMES)[:, None] / FRAMES
    positions = np.repeat(rest[None], FRAMES, axis=0)
    positions[..., 2] += 0.1 * np.sin(4.0 * rest[:, 0] + 6.0 * times)
    positions[..., 1] += 0.3 * times
    return replace(take, positions=positions.astype(np.float32))


def test_a_file_shows_the_vertices_where_the_fit_has_them(tmp_path: Path):
    take = waving()
    mesh = moving_mesh(take)
    skin = glb.write(mesh, tmp_path / "a.glb", joints=6, held=take.held)
    shown = read(tmp_path / "a.glb")
    np.testing.assert_allclose(shown.times, np.arange(FRAMES) / FPS, atol=1e-7)
    assert np.abs(shown.vertices - skin.positions() @ TURN.T).max() < WITHIN
    np.testing.assert_allclose(shown.weights.sum(axis=1), 1.0, atol=1e-6)
    assert shown.weights.min() >= 0.0
    assert shown.parents.count(None) == 1
    assert all(parent is None or parent < joint for joint, parent in enumerate(shown.parents))
    off = np.linalg.norm(skin.positions() - mesh.positions, axis=2)
    moved = np.linalg.norm(mesh.positions - mesh.positions[0], axis=2)
    assert off.max() < 0.05 * moved.max()


def test_a_rigid_motion_needs_one_joint():
    """The fit is then the absolute orientation of all vertices, which is exact."""
    rng = np.random.default_rng(3)
    rest, count = rng.normal(size=(20, 3)), 5
    turns = quaternions.to_matrix(quaternions.from_rotation_vector(rng.normal(size=(count, 3))))
    turns[0] = np.eye(3)
    positions = rest @ turns.transpose(0, 2, 1) + np.arange(count)[:, None, None] * [1.0, 2.0, 3.0]
    skin = fit(positions, Joints(np.array([7]), np.array([-1]), np.ones((1, 20))))
    assert np.abs(skin.positions() - positions).max() < 1e-12
    assert np.abs(skin.rotations[:, 0] - turns).max() < 1e-12


def test_two_rigid_halves_are_told_apart():
    """Vertices of one half follow its joint alone, as if the weights had been known."""
    rng = np.random.default_rng(4)
    rest, count = rng.normal(size=(40, 3)), 6
    half = np.arange(40) % 2
    turns = quaternions.to_matrix(quaternions.from_rotation_vector(rng.normal(size=(count, 2, 3))))
    turns[0] = np.eye(3)
    positions = np.einsum("fvij,vj->fvi", turns[:, half], rest) + np.arange(count)[:, None, None] * 0.1
    near = np.where(half == np.arange(2)[:, None], 1.0, 1.5)
    skin = fit(positions, Joints(np.array([0, 1]), np.array([-1, 0]), near))
    moved = np.abs(positions - rest).max()
    assert np.abs(skin.positions() - positions).max() < 0.02 * moved
    own = np.take_along_axis(skin.influences, skin.weights.argmax(axis=1)[:, None], axis=1)[:, 0]
    assert np.array_equal(own, half)


@pytest.mark.parametrize("begun", ["there", "unturned", "anywhere"])
def test_rotations_are_those_of_singular_values(begun: str):
    """scipy's, of matrices that mirror or flatten too, and of those that hardly tell: whatever they begin from."""
    count, rng = 400, np.random.default_rng(8)
    vectors = rng.normal(scale=2.0, size=(3, count, 3))
    turns, axes, others = quaternions.to_matrix(quaternions.from_rotation_vector(vectors))
    stretch = rng.uniform(0.2, 1.0, size=(count, 3))
    stretch[0::4, 2] = -0.5 * stretch[0::4, :2].min(axis=1)
    stretch[1::4, 2] = 0.0
    stretch[2::4, 1:] *= 1e-11  # so little that a step would be all rounding
    matrices = turns @ (axes * stretch[:, None]) @ axes.swapaxes(1, 2)
    expected = np.array([Rotation.align_vectors(each.T, np.eye(3))[0].as_matrix() for each in matrices])
    begin = {"there": expected, "unturned": np.tile(np.eye(3), (count, 1, 1)), "anywhere": others}[begun]
    found = nearest_rotations(matrices.transpose(2, 0, 1), begin.transpose(2, 0, 1)).transpose(1, 2, 0)
    # Rounding, over how little a turn can cost: the sum of the lesser two, of about one.
    lesser = np.sort(np.abs(stretch), axis=1)[:, 1] + np.sign(stretch[:, 2]) * np.sort(np.abs(stretch), axis=1)[:, 0]
    assert (np.abs(found - expected).max(axis=(1, 2)) < 1e-14 / lesser).all()
    assert np.abs(found @ found.swapaxes(1, 2) - np.eye(3)).max() < 1e-14


def test_joints_that_share_no_vertex_are_fitted_as_if_one_after_another():
    """Each takes a step to its own best, given those before it as they are by then, and those after it as they were."""
    take = waving()
    positions = take.positions.astype(float)
    chains = spread(positions[0], take.triangles, take.held, 8)
    candidates = Candidates.among(chains, positions[0])
    weights = candidates.first_weights(2)
    paths = positions.transpose(1, 0, 2).reshape(len(weights), -1)
    motions = np.zeros((8, 4, paths.shape[1]))
    motions[:, :3] = np.tile(np.eye(3), FRAMES)
    motions[:, 3] = paths[chains.vertices]
    expected = motions.copy()
    fit_motions(motions, paths, candidates, weights)
    local = positions[0][:, None] - candidates.centers
    dense = np.zeros((len(weights), 8))
    np.put_along_axis(dense, candidates.joints, weights, axis=1)
    for k in range(8):
        parts = dense.T[..., None] * (local.swapaxes(0, 1) @ expected[:, :3] + expected[:, 3:])
        left = (paths - parts.sum(axis=0) + parts[k]).reshape(len(weights), FRAMES, 3)
        own = dense[:, k] > 0.0
        w, middle = dense[own, k], np.average(local[own, k], axis=0, weights=dense[own, k] ** 2)
        for f in range(FRAMES):
            goal = left[own, f] / w[:, None]
            mean = np.average(goal, axis=0, weights=w**2)
            turn = Rotation.align_vectors(goal - mean, local[own, k] - middle, weights=w**2)[0].as_matrix()
            expected[k, :3, 3 * f : 3 * f + 3], expected[k, 3, 3 * f : 3 * f + 3] = turn.T, mean - turn @ middle
    assert np.abs(motions - expected).max() < 1e-9


@pytest.mark.parametrize("most", [8, 4, 1])
@pytest.mark.parametrize("begun", ["even", "one", "some"])
def test_weights_are_those_of_least_squares_one_by_one(most: int, begun: str):
    """scipy's, a point at a time, with a large weight on the sum's being one; whatever they begin from."""
    rng = np.random.default_rng(6)
    errors = rng.normal(size=(60, 8, 30)) * rng.uniform(0.01, 1.0, size=(60, 8, 1)) + 0.3 * rng.normal(size=(60, 1, 30))
    near = {"even": np.full((60, 8), 1.0 / 8.0), "one": np.eye(8)[rng.integers(8, size=60)]}
    near["some"] = np.where(rng.random((60, 8)) < 0.5, near["one"], near["even"])
    found = blend(errors @ errors.transpose(0, 2, 1), most, near[begun])
    counts = []
    for point, weights in zip(errors, found, strict=True):
        matrix, wanted = np.vstack([point.T, np.full(8, 1e4)]), np.append(np.zeros(30), 1e4)
        expected = nnls(matrix, wanted)[0]
        counts.append(np.count_nonzero(expected))
        if counts[-1] > most:
            best = np.argsort(-expected)[:most]
            expected = np.zeros(8)
            expected[best] = nnls(matrix[:, best], wanted)[0]
        np.testing.assert_allclose(weights, expected / expected.sum(), atol=1e-6)
    assert max(counts) > 5 > 3 > min(counts)


def test_guesses_that_are_the_same_or_exact_blend():
    """All of which are right: any weights of sum one will do; or of which one is, which then is all."""
    same = blend(np.zeros((1, 8, 8)), 4, np.full((1, 8), 1.0 / 8.0))
    assert (same.sum(), (same >= 0.0).all(), np.count_nonzero(same) <= 4) == (1.0, True, True)
    errors = np.random.default_rng(7).normal(size=(1, 5, 9))
    errors[0, 3] = 0.0
    np.testing.assert_allclose(
        blend(errors @ errors.transpose(0, 2, 1), 4, np.full((1, 5), 0.2))[0], [0, 0, 0, 1, 0], atol=1e-9
    )


def test_chains_go_from_where_a_cloth_is_held_to_its_hem():
    x, y = np.meshgrid(np.arange(5.0), np.arange(9.0))
    places = np.stack([x.ravel(), 0.0 * x.ravel(), -y.ravel()], axis=1)
    corner = np.arange(45).reshape(9, 5)[:-1, :-1].ravel()
    triangles = np.concatenate(
        [np.stack([corner, corner + 1, corner + 5], 1), np.stack([corner + 1, corner + 6, corner + 5], 1)]
    )
    found = spread(places, triangles.astype(np.int32), np.arange(5), 12)
    assert len(set(found.vertices.tolist())) == 12
    assert 2 in found.vertices  # the middle of the held edge
    assert found.parents[0] == -1
    nearest = [found.distances[:k, found.vertices[k]].min() for k in range(1, 12)]
    assert found.distances[found.parents[1:], found.vertices[1:]].tolist() == nearest
    levels = [0]
    for parent in found.parents[1:]:
        levels.append(levels[parent] + 1)
    assert max(levels) >= 3
    depth = y.ravel()[found.vertices]
    assert (np.diff(depth) >= 0.0).all()
    assert (depth[found.parents[1:]] <= depth[1:]).all()
    # No vertex is farther from a joint than twice the radius of as many discs that cover the sheet.
    assert found.distances.min(axis=0).max() < 2.5


def test_a_piece_of_its_own_has_a_chain_of_its_own():
    places = np.array([[0, 0, 1], [1, 0, 1], [0, 0, 0], [9, 0, 1], [9.5, 0, 1], [9, 0, 0.5]], float)
    found = spread(places, np.array([[0, 1, 2], [3, 4, 5]], np.int32), np.array([0]), 4)
    assert np.isinf(found.distances).any()
    assert np.count_nonzero(found.parents < 0) == 2
    assert {int(v) // 3 for v in found.vertices[found.parents < 0]} == {0, 1}


def test_by_command_it_is_told_how_far_off_it_is(tmp_path: Path, forks: Forks):
    waving().keep(tmp_path / "a.npz")
    done = forks("export", "a.npz", "-o", "a.glb", "--joints", "5", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert "5 joints put the cloth" in " ".join(done.stdout.split())
    assert read(tmp_path / "a.glb").vertices.shape == (FRAMES, 30, 3)
    for arguments, told in {
        ("a.obj", "--joints", "5"): "joints are for binary glTF",
        ("b.glb", "--joints", "31"): "1 to 30 joints, not 31",
        ("b.glb", "--joints", "0"): "--joints",
    }.items():
        done = forks("export", "a.npz", "-o", *arguments, folder=tmp_path)
        assert (done.returncode, told in done.stderr) == (2, True), done.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.glb", "a.npz"]


def test_the_least_of_cloths(tmp_path: Path):
    """A single frame, a single joint, and fewer joints than a vertex may follow."""
    take = make_take(1)
    for joints in (1, 2, 3):
        with pytest.warns(UserWarning, match="0.0 mm"):
            take.export(tmp_path / "a.glb", joints=joints)
        assert np.abs(read(tmp_path / "a.glb").vertices - take.positions @ TURN.T).max() < WITHIN
    with pytest.raises(UserError, match="joints are for binary glTF"):
        take.export(tmp_path / "a.usd", joints=3)
