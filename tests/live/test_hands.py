"""Cloth that is taken in the hand, led, and let go."""

import numpy as np
import pytest

import cape
from cape.live.holds import corners
from cape.live.rig import HANDS, Rig
from cape.live.sources import ToldSource
from motions.errors import ValueRangeError
from tests.live.rigs import advance, swinging

RAISED = np.array([0.0, 0.0, 0.2])  # m
# All of the sheet's 0.19 kg at one hand, at twice its weight as it swings, draws it off by 2 m g / k, k over 200 N/m.
OFF = 0.02  # m


def held(rig: Rig) -> set[int]:
    """The vertices that hands hold."""
    return {vertex for vertex in rig.simulation.in_hand if vertex >= 0}


def test_a_vertex_goes_where_a_hand_leads_it_and_falls_when_it_is_let_go():
    """At once: nothing is made ready for it, and what the scene is stays."""
    rig, changes, builder = swinging(self_contact=False)
    vertex, simulation, scene = int(corners(rig.scene.cloth)["bottom left"][0]), rig.simulation, rig.scene
    goal = rig.simulation.positions[vertex] + RAISED
    changes.take_hold(vertex)
    assert held(rig) == {vertex}
    changes.reach(vertex, goal)
    advance(rig, 20)
    np.testing.assert_allclose(rig.simulation.positions[vertex], goal, atol=OFF)
    changes.let_go(vertex)
    assert held(rig) == set()
    advance(rig, 20)
    assert rig.simulation.positions[vertex, 2] < goal[2] - 0.05
    changes.let_go(vertex)  # of what no hand holds
    changes.reach(vertex, goal)
    assert not builder.waiting
    assert rig.simulation is simulation
    assert rig.scene is scene


def test_what_is_taken_stays_where_it_was_taken():
    """Also if it was on its way: within a frame or two it is stopped."""
    rig, changes, _ = swinging(self_contact=False)
    vertex = int(corners(rig.scene.cloth)["bottom left"][0])
    there = rig.simulation.positions[vertex].copy()
    assert np.linalg.norm(rig.simulation.velocities[vertex]) > 0.2
    changes.take_hold(vertex)
    for _ in range(30):
        advance(rig, 1)
        np.testing.assert_allclose(rig.simulation.positions[vertex], there, atol=OFF)


def test_what_a_bone_holds_stays_its_own_and_the_next_vertex_is_taken():
    rig, changes, _ = swinging(self_contact=False)
    corner = int(rig.scene.cloth.region("top_left")[0])
    off = np.linalg.norm(rig.simulation.positions - rig.simulation.positions[corner], axis=1)
    off[[int(vertex) for each in rig.scene.attachments for vertex in each.vertices]] = np.inf
    assert np.isinf(off[corner])
    changes.take_hold(corner)
    assert held(rig) == {int(off.argmin())}
    goal = rig.simulation.positions[off.argmin()] + 0.1 * RAISED
    changes.reach(corner, goal)
    advance(rig, 10)
    np.testing.assert_allclose(rig.simulation.positions[off.argmin()], goal, atol=OFF)
    changes.let_go(corner)
    assert held(rig) == set()


def test_what_is_pinned_already_is_led_and_stays_pinned():
    rig, changes, builder = swinging(self_contact=False)
    changes.pin("bottom left")
    builder.work()
    builder.hand_over()
    corner, scene = int(corners(rig.scene.cloth)["bottom left"][0]), rig.scene
    goal = rig.simulation.positions[corner] + RAISED
    changes.take_hold(corner)
    changes.reach(corner, goal)
    changes.let_go(corner)
    assert not builder.waiting
    assert held(rig) == set()
    advance(rig, 20)
    np.testing.assert_allclose(rig.simulation.positions[corner], goal, atol=1e-6)
    assert rig.scene is scene


def test_two_hands_at_the_same_vertex_let_go_of_it_with_the_first():
    rig, changes, _ = swinging(self_contact=False)
    changes.take_hold(100)
    changes.take_hold(100)
    assert held(rig) == {100}
    changes.let_go(100)
    assert held(rig) == set()


def test_a_hand_holds_on_while_another_cloth_takes_over_and_not_to_what_is_let_go_meanwhile():
    """Another solver, the one before, another fabric; what a bone holds from then on is in no hand."""
    rig, changes, builder = swinging(self_contact=False)
    vertex = int(corners(rig.scene.cloth)["bottom left"][0])
    goal = rig.simulation.positions[vertex] + RAISED
    changes.take_hold(vertex)
    changes.take_hold(100)
    changes.reach(vertex, goal)
    advance(rig, 20)
    for change in (lambda: changes.set_solver("xpbd"), lambda: changes.set_fabric("denim")):
        change()
        builder.work()
        builder.hand_over()
        assert held(rig) == {vertex, 100}
        advance(rig, 5)
        np.testing.assert_allclose(rig.simulation.positions[vertex], goal, atol=OFF)
    changes.set_solver("backward_euler")
    builder.work()
    builder.hand_over()
    changes.let_go(100)
    changes.set_solver("xpbd")  # which stands by, as it was left with both
    assert held(rig) == {vertex}
    changes.pin("bottom left")
    builder.work()
    builder.hand_over()
    assert held(rig) == set()


def test_what_can_not_be_taken_is_told():
    rig, changes, _ = swinging(self_contact=False)
    vertices = rig.scene.cloth.vertices
    with pytest.raises(ValueRangeError, match=f"0 to {vertices - 1}"):
        changes.take_hold(vertices)
    free = [v for v in range(vertices) if rig.simulation.assembly.loose[v]]
    for vertex in free[:HANDS]:
        changes.take_hold(vertex)
    with pytest.raises(ValueRangeError, match="no more can"):
        changes.take_hold(free[HANDS])
    changes.let_go(free[3])
    changes.take_hold(free[HANDS])
    assert free[HANDS] in held(rig)


def test_a_cloth_that_bones_hold_all_over_can_not_be_taken():
    sheet = cape.Cloth.rectangle(width=0.2, height=0.2, spacing=0.1)
    scene = cape.Scene(sheet, [cape.attach(sheet, "rod", np.arange(sheet.vertices))])
    rig, _, _ = swinging(self_contact=False)
    rig.start()
    other = Rig(scene, rig.hands.source, cape.SymplecticEuler(), threads=1)
    other.start()
    with pytest.raises(ValueRangeError, match="all of the cloth"):
        other.take_hold(3)


def test_a_cloth_that_is_put_on_anew_as_bones_jump_is_in_no_hand():
    sheet = cape.Cloth.rectangle(width=0.4, height=0.4, spacing=0.1)
    scene = cape.Scene(sheet, [cape.attach(sheet, "rod", "top")])
    place = [0.0]
    told = ToldSource(lambda _: {"rod": (np.array([place[0], 0.0, 0.0]), (1.0, 0.0, 0.0, 0.0))}, scene.bones)
    rig = Rig(scene, told, cape.SymplecticEuler(), threads=1)
    rig.simulation.cuts = cape.Cuts(then="reset")
    rig.start()
    rig.take_hold(12)
    advance(rig, 2)
    assert rig.in_hand
    place[0] = 50.0
    advance(rig, 2)
    assert rig.simulation.renewed == 1
    assert not rig.in_hand
    assert held(rig) == set()
    np.testing.assert_allclose(rig.simulation.positions[:, 0], 50.0, atol=0.1)
