"""Hands that take hold of a running cloth: how firmly, at what cost, and what they can't."""

import numpy as np
import pytest

import cape
from cape.assembly.stability import Ground, largest_frequency
from cape.kernels.implicit.stiffness import add_pull_blocks
from cape.kernels.solve.soft import aim_pull, draw_vertices, pull_vertices
from cape.solvers.base import GRIP
from motions.errors import ValueRangeError

FRAME = 1.0 / 60.0
SHEET = cape.Cloth.rectangle(width=0.3, height=0.3, spacing=0.1)
FREE = cape.Scene(SHEET)
HELD = cape.Scene(SHEET, [cape.attach(SHEET, "rod", "top")], tearing=cape.Tearing(strain=0.5))
ROD = {"rod": ([0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0])}


def started(scene: cape.Scene, *, solver: str = "euler", hands: int = 0) -> cape.Simulation:
    simulation = cape.Simulation(scene, solver=cape.solver(solver), hands=hands)
    simulation.start(ROD if scene.bones else {})
    return simulation


@pytest.mark.parametrize("solver", ["xpbd", "backward_euler", "tr_bdf2"])
def test_a_hand_gives_way_by_the_weight_over_its_stiffness(solver: str):
    """A sheet that a hand holds at every vertex, where hand k has the share of one vertex: off by m g / k each."""
    simulation = started(FREE, solver=solver, hands=SHEET.vertices)
    before = simulation.positions.copy()
    for vertex in range(SHEET.vertices):
        simulation.take_hold(vertex, vertex)
    for _ in range(60):
        simulation.step({}, FRAME)
    # What threads even out between neighbours is left out by the sum: forces between vertices are none in all.
    off = (before - simulation.positions)[:, 2]
    assert off.sum() * GRIP == pytest.approx(simulation.mass * 9.81, rel=0.01)
    assert simulation.unconverged == simulation.troubled == simulation.retried == 0


def test_symplectic_euler_holds_as_firmly_as_its_step_has_room_for():
    """The largest frequency and damping of the cloth with a hand stay within w^2 h^2 + 2 c h = 4, and well beyond half
    of the room is used."""
    simulation = started(FREE, hands=1)
    running, assembly, pull = simulation._started.running, simulation.assembly, simulation.assembly.hands
    assert pull is not None
    margin = cape.SymplecticEuler().margin
    step, used = margin * running.arrays.stable_step, []
    flat = np.column_stack([SHEET.pattern, np.zeros(SHEET.vertices)])
    alone = largest_frequency(assembly.springs, assembly.inverse_mass, flat)
    for vertex in range(SHEET.vertices):
        simulation.take_hold(0, vertex)
        ground = Ground(*np.zeros((2, SHEET.vertices)))
        ground.stiffness[vertex], ground.damping[vertex] = (pull.stiffness[0], pull.damping[0])
        frequency = largest_frequency(assembly.springs, assembly.inverse_mass, flat, ground)
        rate = SHEET.fabric.damping_time * frequency**2 + ground.damping[vertex] * assembly.inverse_mass[vertex]
        assert frequency**2 * step**2 + 2.0 * rate * step < 4.0
        used.append(ground.stiffness[vertex] * assembly.inverse_mass[vertex] * step**2)
    assert alone * step < 2.0 * margin * 1.001
    assert min(used) == pytest.approx(0.2, rel=1e-9)
    for _ in range(300):
        simulation.step({}, FRAME)
    assert np.abs(simulation.velocities).max() < 5.0


def test_hands_that_hold_nothing_change_nothing_and_none_compile_nothing():
    many, none = started(HELD, hands=16), started(HELD)
    for name, own in (
        ("euler", {pull_vertices}),
        ("xpbd", {draw_vertices}),
        ("tr_bdf2", {pull_vertices, add_pull_blocks}),
    ):
        solver = cape.solver(name)
        runs = (cape.Simulation(HELD, solver=solver, hands=n) for n in (1, 0))
        asked = [{request.function for request in run.requests(ROD)} for run in runs]
        assert asked[0] - asked[1] == {aim_pull, *own}
        assert not asked[1] & {aim_pull, pull_vertices, draw_vertices, add_pull_blocks}
    assert none.assembly.hands is None
    for _ in range(20):
        many.step(ROD, FRAME)
        none.step(ROD, FRAME)
        np.testing.assert_array_equal(many.positions, none.positions)


def test_a_hand_moves_evenly_through_a_frame_and_is_there_at_its_end():
    """One that moves at 1 m/s draws a free sheet along at its velocity, without first being left behind."""
    simulation = started(FREE, solver="backward_euler", hands=SHEET.vertices)
    before = simulation.positions.copy()
    for vertex in range(SHEET.vertices):
        simulation.take_hold(vertex, vertex)
    for frame in range(1, 31):
        for vertex in range(SHEET.vertices):
            simulation.lead(vertex, before[vertex] + [frame * FRAME, 0.0, 0.0])
        simulation.step({}, FRAME)
    np.testing.assert_allclose(simulation.velocities[:, 0], 1.0, atol=1e-3)
    np.testing.assert_allclose(simulation.positions[:, 0] - before[:, 0], 30 * FRAME, atol=1e-3)


def test_what_a_hand_holds_does_not_split_until_it_is_let_go():
    simulation = started(HELD, hands=2)
    middle = int(SHEET.region("bottom")[1])
    path = [middle, middle - SHEET.columns, middle - 2 * SHEET.columns]
    simulation.take_hold(0, path[1])
    simulation.take_hold(1, path[1])
    simulation.let_go(0)
    simulation.tear(path)
    assert path[0] in simulation.topology.parents[SHEET.vertices :]
    assert path[1] not in simulation.topology.parents[SHEET.vertices :]
    simulation.let_go(1)
    simulation.tear(path)
    assert path[1] in simulation.topology.parents[SHEET.vertices :]


def test_what_hands_can_not_do_is_told():
    simulation = started(HELD, hands=1)
    for hand, vertex, told in (
        (1, 5, "1 hands"),
        (0, SHEET.vertices, "and no"),
        (0, 0, "bone holds"),
        (-1, 5, "hands"),
    ):
        with pytest.raises(ValueRangeError, match=told):
            simulation.take_hold(hand, vertex)
    with pytest.raises(ValueRangeError, match="three finite"):
        simulation.lead(0, (0.0, np.nan, 0.0))
    with pytest.raises(ValueRangeError, match="hands"):
        cape.Simulation(HELD, hands=65)
    with pytest.raises(ValueRangeError, match="ledger"):
        cape.Simulation(HELD, hands=1, ledger=cape.Ledger())
    simulation.start(ROD)
    assert simulation.in_hand == (-1,)
