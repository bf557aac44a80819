"""Cloth that is taken in the hand, led, and let go."""

import numpy as np
import pytest

import cape
from cape.live.holds import corners
from cape.live.rig import Rig
from motions.errors import ValueRangeError
from tests.live.rigs import Later, advance, swinging

RAISED = np.array([0.0, 0.0, 0.2])  # m


def held(rig: Rig) -> set[int]:
    return {int(vertex) for attachment in rig.scene.attachments for vertex in attachment.vertices}


def handed_over(rig: Rig, builder: Later) -> list[str]:
    builder.work()
    told = builder.hand_over()
    advance(rig, 20)
    return told


def test_a_vertex_goes_where_a_hand_leads_it_and_falls_when_it_is_let_go():
    """Also where it was led while it was only being taken hold of, and then no further."""
    rig, changes, builder = swinging(self_contact=False)
    vertex, before = int(corners(rig.scene.cloth)["bottom left"][0]), held(rig)
    goal = rig.simulation.positions[vertex] + RAISED
    changes.take_hold(vertex)
    changes.reach(vertex, goal)
    assert handed_over(rig, builder) == [f"vertex {vertex} pinned"]
    np.testing.assert_allclose(rig.simulation.positions[vertex], goal, atol=1e-6)
    assert held(rig) == {*before, vertex}
    changes.let_go(vertex)
    assert handed_over(rig, builder) == [f"vertex {vertex} let go"]
    assert rig.simulation.positions[vertex, 2] < goal[2] - 0.05
    assert held(rig) == before
    changes.let_go(vertex)  # of what no hand holds
    changes.reach(vertex, goal)
    assert not builder.waiting


def test_who_lets_go_before_it_is_held_leaves_nothing_behind():
    rig, changes, builder = swinging(self_contact=False)
    before = held(rig)
    for _ in range(3):
        changes.take_hold(100)
        changes.let_go(100)
    handed_over(rig, builder)
    assert held(rig) == before


def test_what_a_bone_holds_stays_its_own_and_the_next_vertex_is_taken():
    rig, changes, builder = swinging(self_contact=False)
    corner, before = int(rig.scene.cloth.region("top_left")[0]), held(rig)
    assert corner in before
    off = np.linalg.norm(rig.simulation.positions - rig.simulation.positions[corner], axis=1)
    off[[*before]] = np.inf
    changes.take_hold(corner)
    assert handed_over(rig, builder) == [f"vertex {off.argmin()} pinned"]
    goal = rig.simulation.positions[off.argmin()] + 0.1 * RAISED
    changes.reach(corner, goal)
    advance(rig, 10)
    np.testing.assert_allclose(rig.simulation.positions[off.argmin()], goal, atol=1e-6)
    assert held(rig) == {*before, int(off.argmin())}
    changes.let_go(corner)
    handed_over(rig, builder)
    assert held(rig) == before


def test_what_is_pinned_already_is_led_and_stays_pinned():
    rig, changes, builder = swinging(self_contact=False)
    changes.pin("bottom left")
    handed_over(rig, builder)
    corner, pinned = int(corners(rig.scene.cloth)["bottom left"][0]), held(rig)
    goal = rig.simulation.positions[corner] + RAISED
    changes.take_hold(corner)
    changes.reach(corner, goal)
    changes.let_go(corner)
    assert not builder.waiting
    advance(rig, 20)
    np.testing.assert_allclose(rig.simulation.positions[corner], goal, atol=1e-6)
    assert held(rig) == pinned


def test_two_hands_at_the_same_vertex_let_go_of_it_with_the_first():
    rig, changes, builder = swinging(self_contact=False)
    before = held(rig)
    changes.take_hold(100)
    changes.take_hold(100)
    handed_over(rig, builder)
    changes.let_go(100)
    handed_over(rig, builder)
    assert held(rig) == before


def test_what_can_not_be_taken_is_told():
    rig, changes, builder = swinging(self_contact=False)
    vertices = rig.scene.cloth.vertices
    with pytest.raises(ValueRangeError, match=f"0 to {vertices - 1}"):
        changes.take_hold(vertices)
    everything = cape.Scene(rig.scene.cloth, [cape.attach(rig.scene.cloth, rig.scene.bones[0], np.arange(vertices))])
    with pytest.raises(ValueRangeError, match="all of the cloth"):
        rig.with_hand(everything, 3)
    changes.tear()
    builder.work()
    builder.hand_over()
    with pytest.raises(ValueRangeError, match="torn"):
        changes.take_hold(3)
