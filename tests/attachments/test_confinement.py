"""Vertices that stay near their animated positions, or before them: spheres and what they take, by closed forms."""

import dataclasses

import numpy as np
import pytest

from cape import (
    Ledger,
    Pose,
    Scene,
    Simulation,
    Solver,
    attach,
    confine,
)
from cape.assembly.geodesics import geodesic_distances
from cape.kernels.jit import routine
from cape.kernels.solve import confine as kernels
from cape.kernels.solve.attachments import Attached, Blend
from motions import quaternions
from motions.errors import ValueRangeError
from tests.attachments.closely import EVERY, FRAME, LIMP, G, every_solver
from tests.support.scenes import grid_cloth, mesh_cloth, turn_about
from tests.support.shapes import moving

UNTURNED = np.array([1.0, 0.0, 0.0, 0.0])
FLOATING = (0.0, 0.0, 0.0)


def at(place, turn=UNTURNED) -> Pose:
    return Pose(np.array([place], float), np.array([turn], float))


HERE = at((0, 0, 0))


def plate(make=grid_cloth):
    """3 x 3 vertices of 0.2 m in the plane of X and Y, its outer side up; 8 g in all."""
    return make(np.linspace(0, 0.2, 3), np.linspace(0, 0.2, 3), LIMP, down=(0.0, -1.0, 0.0))


@every_solver
@pytest.mark.parametrize("make", [grid_cloth, mesh_cloth], ids=["grid", "mesh"])
@pytest.mark.few("grid-xpbd", "mesh-euler", "grid-tr_bdf2", "mesh-backward_euler")
def test_what_falls_is_caught_at_its_distance_and_loses_its_energy(solver: Solver, make):
    cloth, far = plate(make), 0.05
    ledger = Ledger()
    scene = Scene(cloth, confinements=[confine(cloth, "body", max_distance=far)])
    simulation = Simulation(scene, solver=solver, cuts=None, ledger=ledger)
    simulation.start(HERE)
    falling = np.sqrt(2 * far / G)
    for frame in range(1, 13):
        simulation.step(HERE, FRAME)
        if frame * FRAME < falling - FRAME:
            drop, step = 0.5 * G * (frame * FRAME) ** 2, 0.5 * G * frame * FRAME * FRAME / 20
            fallen = cloth.positions[:, 2] - simulation.positions[:, 2]
            np.testing.assert_allclose(fallen, drop, atol=1.01 * step + 1e-9)
    np.testing.assert_allclose(simulation.positions, cloth.positions - [0, 0, far], atol=1e-9)
    weight = 0.2 * 0.04 * G
    assert ledger.balance.potential[-1] - ledger.balance.potential[0] == pytest.approx(-weight * far, rel=1e-6)
    assert ledger.balance.contacts[-1] == pytest.approx(-weight * far, rel=0.02)


@every_solver
def test_what_hangs_at_its_distance_swings_as_a_pendulum(solver: Solver):
    cloth, far, swing = plate(), 0.1, 0.02  # m, m of amplitude
    scene = Scene(cloth, confinements=[confine(cloth, "body", max_distance=far)])
    simulation = Simulation(scene, solver=dataclasses.replace(solver, substeps=40), cuts=None)
    simulation.start(HERE)
    angle = np.arcsin(swing / far)
    simulation.disturb(np.tile([far * np.sin(angle), 0.0, -far * np.cos(angle)], (9, 1)))
    sideways = []
    for _ in range(150):
        simulation.step(HERE, FRAME)
        sideways.append(simulation.positions[4, 0] - cloth.positions[4, 0])
        np.testing.assert_allclose(np.linalg.norm(simulation.positions - cloth.positions, axis=1), far, rtol=1e-3)
    sideways = np.array(sideways)
    crossings = np.flatnonzero((sideways[:-1] > 0.0) != (sideways[1:] > 0.0))
    times = crossings + sideways[crossings] / (sideways[crossings] - sideways[crossings + 1])
    period = 2.0 * FRAME * np.diff(times).mean()
    # Of the amplitude 0.2 rad, which only shrinks: 1 + a^2 / 16 of that of small swings.
    assert period == pytest.approx(2 * np.pi * np.sqrt(far / G), rel=0.01)


@every_solver
def test_no_vertex_leaves_its_sphere_however_its_bone_moves(solver: Solver):
    cloth = grid_cloth(np.linspace(0, 0.3, 4), np.linspace(0, 0.6, 7), LIMP)
    hold = attach(cloth, "body", range(4))
    ways, _ = geodesic_distances(cloth, np.arange(4))
    found = []
    for far in (lambda way: 0.15 * way, 0.15 * ways, None):
        confinements = [] if far is None else [confine(cloth, "body", max_distance=far)]
        simulation = Simulation(Scene(cloth, [hold], confinements=confinements), solver=solver, cuts=None)
        simulation.start(HERE)
        away = np.zeros(len(ways))
        for frame in range(1, 31):
            pose = at((0.1 * np.sin(0.4 * frame), 0, 0), turn_about((0, 0, 1), 0.5 * np.sin(0.3 * frame)))
            simulation.step(pose, FRAME)
            animated = pose.positions[0] + quaternions.rotate(pose.rotations_wxyz[0], cloth.positions)
            away = np.linalg.norm(simulation.positions - animated, axis=1)
            if far is not None:
                # The last of a bone's steps turns what is put back by less than the digits of a turn of many.
                assert (away <= 0.15 * ways + 1e-7).all()
        found.append(away)
    np.testing.assert_array_equal(found[0], found[1])
    assert (found[2] > 0.15 * ways + 0.02).any()


def test_a_distance_of_nothing_nails_vertices_to_where_bones_carry_them():
    cloth = plate()
    scene = Scene(cloth, confinements=[confine(cloth, {"a": 1.0, "b": 3.0}, [0, 4], max_distance=[0.0, np.inf])])
    simulation = Simulation(scene, solver=EVERY[0], cuts=None)
    where = Pose(np.zeros((2, 3)), np.tile(UNTURNED, (2, 1)))
    simulation.start(where)
    for frame in range(1, 11):
        moved = Pose(np.array([[0.0, 0.0, 0.0], [0.004 * frame, 0.0, 0.0]]), where.rotations_wxyz)
        simulation.step(moved, FRAME)
    np.testing.assert_allclose(simulation.positions[0], cloth.positions[0] + [0.03, 0, 0], atol=1e-9)
    assert simulation.positions[4, 2] < -0.05


@every_solver
def test_what_falls_onto_its_backstop_comes_to_rest_there(solver: Solver):
    cloth = plate()
    scene = Scene(cloth, confinements=[confine(cloth, "body", backstop=0.03, backstop_radius=2.0)])
    simulation = Simulation(scene, solver=solver, cuts=None)
    simulation.start(HERE)
    for _ in range(20):
        simulation.step(HERE, FRAME)
    np.testing.assert_allclose(simulation.positions, cloth.positions - [0, 0, 0.03], atol=1e-9)
    # With its outer side down the sphere is above it: nothing keeps it from falling.
    over = grid_cloth(np.linspace(0, 0.2, 3), np.linspace(0, 0.2, 3), LIMP, down=(0.0, 1.0, 0.0))
    scene = Scene(over, confinements=[confine(over, "body", backstop=0.03, backstop_radius=2.0)])
    simulation = Simulation(scene, solver=solver, cuts=None)
    simulation.start(HERE)
    for _ in range(20):
        simulation.step(HERE, FRAME)
    assert simulation.positions[:, 2].max() < -0.4


@every_solver
def test_no_vertex_gets_into_its_backstop_however_its_bone_turns(solver: Solver):
    cloth, behind, radius = plate(), 0.02, 0.1
    scene = Scene(
        cloth,
        gravity=FLOATING,
        confinements=[confine(cloth, "body", backstop=behind, backstop_radius=radius, max_distance=0.08)],
    )
    simulation = Simulation(scene, solver=solver, cuts=None)
    simulation.start(HERE)
    pushed, before = False, np.zeros(3)
    for frame in range(1, 41):
        pose = at((0, 0.1 * np.sin(0.2 * frame), 0.15 * np.sin(0.3 * frame)), turn_about((1, 0, 0), 0.08 * frame))
        simulation.step(pose, FRAME)
        turn = pose.rotations_wxyz[0]
        animated = pose.positions[0] + quaternions.rotate(turn, cloth.positions)
        middles = animated - (behind + radius) * quaternions.rotate(turn, np.array([0.0, 0.0, 1.0]))
        off = np.linalg.norm(simulation.positions - middles, axis=1)
        assert (off >= radius - 1e-7).all()
        pushed |= bool((off < radius + 1e-6).any())
        # What touches goes no slower than the sphere there, but for what that turns by in a step: 4.8 rad/s x 4 mm.
        moves = (pose.positions[0] - before) / FRAME + np.cross([4.8, 0.0, 0.0], middles - pose.positions[0])
        against = np.sum((simulation.velocities - moves) * (simulation.positions - middles), axis=1) / off
        assert (against[off < radius + 1e-6] > -0.02).all()
        before = pose.positions[0]
    assert pushed


@routine
def normal_and_change(normals, animated, blend, m):
    return kernels.carried_normal(normals, animated, blend, 0, m)


@pytest.mark.parametrize("several", [False, True], ids=["one bone", "two bones"])
def test_a_carried_normal_changes_as_the_bones_turn(several: bool):
    rng = np.random.default_rng(5)
    count = 2 if several else 1
    spins = rng.standard_normal((2, 3))
    starts = quaternions.normalize(rng.standard_normal((2, 4)))
    normals = rng.standard_normal((count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    weights = np.array([0.7, 0.3])[:count] / (1.0 if several else 0.7)
    blend = Blend(np.array([0, count]), weights) if several else None
    animated = Attached(np.array([0]), np.arange(count), normals, *np.zeros((2, 1, 3)), blend=blend)

    def normal(time: float) -> np.ndarray:
        turns = quaternions.multiply(quaternions.from_rotation_vector(time * spins), starts)[:count]
        mean = weights @ quaternions.rotate(turns, normals)
        return mean / np.linalg.norm(mean)

    room = moving(np.zeros((2, 3)), spin=spins, matrix=quaternions.to_matrix(starts))
    found = np.array(normal_and_change(normals, animated, blend, room))  # pyright: ignore[reportCallIssue]
    np.testing.assert_allclose(found[:3], normal(0.0), atol=1e-14)
    tick = 1e-5
    # Of central differences a third of tick^2 times the third derivative, and the last digits over the tick.
    np.testing.assert_allclose(found[3:], (normal(tick) - normal(-tick)) / (2 * tick), atol=1e-9)


def test_bones_that_hold_a_vertex_hard_have_the_last_word():
    cloth = plate()
    hold = attach(cloth, "body", [0], points=[cloth.positions[0] + [0.0, 0.0, 0.01]])
    scene = Scene(cloth, [hold], gravity=FLOATING, confinements=[confine(cloth, "body", max_distance=0.0)])
    simulation = Simulation(scene, solver=EVERY[0], cuts=None)
    simulation.start(HERE)
    for _ in range(3):
        simulation.step(HERE, FRAME)
    np.testing.assert_allclose(simulation.positions[0], cloth.positions[0] + [0, 0, 0.01], atol=1e-15)
    np.testing.assert_allclose(simulation.positions[1:], cloth.positions[1:], atol=1e-9)


def test_where_bones_have_jumped_vertices_come_back_at_3_m_s():
    cloth = plate()
    scene = Scene(cloth, gravity=FLOATING, confinements=[confine(cloth, "body", max_distance=0.01)])
    simulation = Simulation(scene, solver=EVERY[0], cuts=None)
    simulation.start(HERE)
    simulation.disturb(np.tile([1.01, 0.0, 0.0], (9, 1)))
    simulation.step(HERE, FRAME)
    np.testing.assert_allclose(
        simulation.positions - cloth.positions, np.tile([1.01 - 3 * FRAME, 0, 0], (9, 1)), atol=1e-12
    )
    np.testing.assert_allclose(simulation.velocities, 0.0, atol=1e-12)


def test_a_confined_cloth_has_the_same_bits_on_two_threads():
    cloth = grid_cloth(np.linspace(0, 1, 21), np.linspace(0, 0.6, 13), LIMP)
    near = confine(cloth, "body", max_distance=lambda way: 0.1 * way, backstop=0.01)
    scene = Scene(cloth, [attach(cloth, "body", range(21))], confinements=[near])
    for solver in EVERY:
        found = []
        for threads in (1, 2):
            simulation = Simulation(scene, solver=solver, threads=threads)
            simulation.start(HERE)
            for frame in range(3):
                simulation.step(at((0.05 * frame, 0.03 * frame, 0)), FRAME)
            found.append(simulation.positions)
        np.testing.assert_array_equal(*found)


@pytest.mark.parametrize(
    "options",
    [
        {},
        {"max_distance": -0.1},
        {"max_distance": np.nan},
        {"max_distance": [0.1, 0.2]},
        {"backstop": -0.1},
        {"backstop": 0.1, "backstop_radius": 0.0},
        {"backstop": 0.1, "backstop_radius": np.inf},
    ],
)
def test_what_makes_no_sense_is_told(options: dict):
    with pytest.raises(ValueRangeError, match="confine"):
        confine(plate(), "body", **options)


def test_maps_that_go_by_what_is_held_are_checked_with_the_scene():
    cloth = plate()
    by_way = confine(cloth, "body", max_distance=lambda way: way - 1.0)
    with pytest.raises(ValueRangeError, match="needs an attachment"):
        Scene(cloth, confinements=[by_way])
    scene = Scene(cloth, [attach(cloth, "body", [0])], confinements=[by_way])
    with pytest.raises(ValueRangeError, match="zero or more"):
        Simulation(scene).start(HERE)
    bounds = [confine(cloth, "body", [3, 4], max_distance=1.0), confine(cloth, "hand", [4], backstop=0.0)]
    with pytest.raises(ValueRangeError, match="vertex 4 is confined more than once"):
        Scene(cloth, confinements=bounds)
