"""What bones hold: between several of them, by closed forms of linear blend skinning."""

import dataclasses

import numpy as np
import pytest

from cape import Cloth, Scene, Simulation, UserError, attach
from cape.reach import reach_of
from cape.scene.colliders import Sphere
from cape.solvers import Solver
from motions.errors import ValueRangeError
from skeleton.track import BoneTrack
from tests.support.scenes import EVERY, turn_about

FRAME = 1 / 60  # s
UNTURNED = np.array([1.0, 0.0, 0.0, 0.0])
FEW = tuple(dataclasses.replace(solver, substeps=20) for solver in EVERY)

every_solver = pytest.mark.parametrize("solver", FEW, ids=lambda s: s.name)


def sheet() -> Cloth:
    """5 x 4 vertices, 0.4 m wide, from the origin to the right and down."""
    return Cloth.rectangle(width=0.4, height=0.3, spacing=0.1, origin=(0.0, 0.0, 0.0))


def moved(simulation: Simulation, start: dict, end: dict, frames: int) -> None:
    """Start at poses, and move in straight lines, at constant turning, to others."""
    simulation.start(start)
    for frame in range(1, frames + 1):
        share = frame / frames
        simulation.step(
            {
                name: (
                    np.asarray(start[name][0]) + share * (np.asarray(end[name][0]) - np.asarray(start[name][0])),
                    turn_about((0.0, 1.0, 0.0), share * end[name][1]),
                )
                for name in start
            },
            FRAME,
        )


@every_solver
def test_between_two_bones_vertices_are_at_the_mean_of_where_each_carries_them(solver: Solver):
    cloth = sheet()
    rng = np.random.default_rng(0)
    weights = rng.uniform(0.1, 1.0, (5, 2))
    weights[0] = (1.0, 0.0)
    scene = Scene(cloth, [attach(cloth, ["a", "b"], range(5), weights=weights)])
    simulation = Simulation(scene, solver=solver)
    a, b = np.array([0.0, 0.0, 0.1]), np.array([0.4, 0.1, 0.0])
    start = {"a": (a, UNTURNED), "b": (b, UNTURNED)}
    shift, angle = np.array([0.0, 0.03, 0.05]), 0.5
    moved(simulation, start, {"a": (a, 0.0), "b": (b + shift, angle)}, 10)
    top = cloth.positions[:5]
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
    by_b = b + shift + (top - b) @ turn.T
    share = weights[:, :1] / weights.sum(axis=1, keepdims=True)
    # In double precision; a turn is put together of 200 small ones.
    np.testing.assert_allclose(simulation.positions[:5], share * top + (1 - share) * by_b, atol=1e-11)


@every_solver
def test_a_clasp_between_bones_that_part_stays_midway(solver: Solver):
    cloth = sheet()
    scene = Scene(cloth, [attach(cloth, {"left": 2.0, "right": 2.0}, range(5))])
    simulation = Simulation(scene, solver=solver)
    left, right = np.array([-0.2, 0.0, 0.0]), np.array([0.6, 0.0, 0.0])
    start = {"left": (left, UNTURNED), "right": (right, UNTURNED)}
    apart = {"left": (left - np.array([0.1, 0.0, 0.0]), 0.0), "right": (right + np.array([0.1, 0.0, 0.04]), 0.0)}
    moved(simulation, start, apart, 5)
    np.testing.assert_allclose(simulation.positions[:5], cloth.positions[:5] + np.array([0.0, 0.0, 0.02]), atol=1e-12)
    # The last frame moves it by 4 mm up: that is what an implicit solver is told, too.
    np.testing.assert_allclose(simulation.velocities[:5, 2], 0.02 / (5 * FRAME), rtol=1e-6)


def test_weights_of_one_bone_give_the_bits_of_that_bone_alone():
    cloth = sheet()
    start = {"a": (np.zeros(3), UNTURNED), "b": (np.ones(3), UNTURNED)}
    end = {"a": (np.array([0.1, 0.0, 0.2]), 0.3), "b": (np.zeros(3), 1.0)}
    found = []
    for hold in (attach(cloth, "a", "top"), attach(cloth, {"a": 1.0, "b": 0.0}, "top")):
        scene = Scene(cloth, [hold], [Sphere(bone="b", center=np.array([9.0, 0.0, 0.0]), radius=0.1)])
        simulation = Simulation(scene, solver=dataclasses.replace(EVERY[0], substeps=50))
        moved(simulation, start, end, 10)
        found.append(simulation.positions)
    np.testing.assert_array_equal(*found)


def test_what_several_bones_hold_has_the_same_bits_on_two_threads():
    cloth = Cloth.rectangle(width=1.0, height=0.6, spacing=0.05)
    scene = Scene(cloth, [attach(cloth, {"a": 1.0, "b": 2.0}, "top"), attach(cloth, "a", [50], stiffness=100.0)])
    start = {"a": (np.zeros(3), UNTURNED), "b": (np.ones(3), UNTURNED)}
    found = []
    for threads in (1, 2):
        simulation = Simulation(scene, threads=threads)
        moved(simulation, start, {"a": (np.array([0.1, 0.0, 0.2]), 0.3), "b": (np.zeros(3), 1.0)}, 5)
        found.append(simulation.positions)
    np.testing.assert_array_equal(*found)


def test_a_jump_of_all_bones_takes_the_cloth_along_and_parts_nothing():
    cloth = sheet()
    clasp, tail = attach(cloth, {"left": 1.0, "right": 3.0}, range(5)), attach(cloth, "left", [19], stiffness=9)
    scene = Scene(cloth, [clasp, tail])
    simulation = Simulation(scene, solver=FEW[0])
    start = {"left": (np.zeros(3), UNTURNED), "right": (np.array([0.4, 0.0, 0.0]), UNTURNED)}
    simulation.start(start)
    simulation.step(start, FRAME)
    before, far = simulation.positions, np.array([30.0, -4.0, 2.0])
    simulation.step({name: (place + far, turn) for name, (place, turn) in start.items()}, FRAME)
    assert simulation.jumps == 1
    np.testing.assert_allclose(simulation.positions[:5], before[:5] + far, atol=1e-12)
    # One frame more of the same fall: at most g t dt, with t of two frames.
    assert np.abs(simulation.positions - far - before).max() < 9.81 * 2 * FRAME * FRAME
    assert simulation.energy.elastic < 1e-3


def test_a_snapshot_holds_what_several_bones_carry():
    cloth = sheet()
    clasp, tail = attach(cloth, {"left": 1.0, "right": 3.0}, range(5)), attach(cloth, "left", [19], stiffness=9)
    scene = Scene(cloth, [clasp, tail])
    start = {"left": (np.zeros(3), UNTURNED), "right": (np.array([0.4, 0.0, 0.0]), UNTURNED)}
    first, second = (Simulation(scene, solver=FEW[0]) for _ in range(2))
    moved(first, start, {"left": (np.zeros(3), 0.2), "right": (np.array([0.4, 0.0, 0.1]), 0.0)}, 5)
    second.start_from(first.snapshot())
    still = {"left": (np.zeros(3), turn_about((0, 1, 0), 0.2)), "right": (np.array([0.4, 0.0, 0.1]), UNTURNED)}
    for simulation in (first, second):
        simulation.step(still, FRAME)
    np.testing.assert_allclose(second.positions, first.positions, atol=1e-12)
    assert second.energy.elastic == pytest.approx(first.energy.elastic, rel=1e-9)


def test_reach_knows_of_vertices_that_leave_their_heaviest_bone():
    cloth = sheet()
    ball = Sphere(name="ball", center=np.array([0.2, 0.0, 1.15]), radius=0.05)
    times = np.linspace(0.0, 2 * FRAME, 3)
    positions = np.zeros((3, 2, 3))
    positions[:, 1, 2] = (0.0, 1.0, 2.0)
    track = BoneTrack(("a", "b"), times, positions, np.tile(UNTURNED, (3, 2, 1)))
    left_out = {}
    for name, hold in {
        "heavy": attach(cloth, "a", "top"),
        "both": attach(cloth, {"a": 0.51, "b": 0.49}, "top"),
    }.items():
        # A way of 0.98 m up, from which the cloth reaches up to 0.35 m further.
        left_out[name] = reach_of(Scene(cloth, [hold], [ball]), track).left_out
    assert "ball" in left_out["heavy"]
    assert not left_out["both"]


@pytest.mark.parametrize(
    ("bone", "options"),
    [
        ((), {}),
        (("a", "a"), {}),
        ({"a": 1.0, "b": -1.0}, {}),
        ({"a": 0.0, "b": 0.0}, {}),
        ({"a": 1.0, "b": [1.0, 2.0]}, {}),
        ({"a": 1.0, "b": 1.0}, {"weights": [1.0, 1.0]}),
        (("a", "b"), {"weights": [1.0, 1.0, 1.0]}),
        (("a", "b"), {"weights": [[1.0, np.nan]]}),
        ("a", {"stiffness": 0.0}),
        ("a", {"stiffness": [1.0, 2.0]}),
        ("a", {"stiffness": 1.0, "damping": -1.0}),
        ("a", {"damping": 1.0}),
    ],
)
def test_what_makes_no_sense_is_told(bone: object, options: dict):
    with pytest.raises(ValueRangeError, match="attach"):
        attach(sheet(), bone, range(5), **options)  # pyright: ignore[reportArgumentType]
    assert issubclass(ValueRangeError, UserError)
