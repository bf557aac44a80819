"""Bringing cloth to rest: ways followed as far as they lead downhill, and a drape in balance."""

import numpy as np
import pytest

from cape import FABRICS, Cloth, Scene, attach
from cape.report.measured.world import rest, triangulations
from cape.report.measured.world.drape import DISC, FALLS, NOISE, PEDESTAL
from cape.report.measured.world.forces import Forces

SPACING = 0.02


def ring() -> tuple[Cloth, np.ndarray]:
    """A ring of cloth set out with a little noise, and the vertices that its pedestal holds."""
    piece = triangulations.ring("random", PEDESTAL, DISC, SPACING)
    held = triangulations.held_by_ring(piece, PEDESTAL, SPACING)
    heights = np.random.default_rng(1).normal(0.0, NOISE, len(piece.points))
    heights[held] = 0.0
    places = np.column_stack([piece.points, heights])
    return Cloth.from_mesh(places, piece.triangles, pattern=piece.points, fabric=FABRICS["worsted"]), held


@pytest.mark.parametrize("end", [0.02, 0.7, 2.5, 150.0])
@pytest.mark.parametrize("cubic", [0.0, 3.0])
def test_a_way_is_followed_to_where_its_slope_is_little(end: float, cubic: float):
    goal, way = end * np.ones((2, 3)), np.ones((2, 3))
    seen = []

    def pull(places: np.ndarray) -> np.ndarray:
        seen.append(places)
        left = (goal - places) / end
        return left + cubic * left**3

    start = np.zeros((2, 3))
    first = pull(start)
    places, force = rest._along(start, way, first, pull)
    np.testing.assert_array_equal(force, pull(places))
    assert abs(float(np.sum(force * way))) <= rest.LEVEL * float(np.sum(first * way))
    assert len(seen) <= rest.TRIES + 2


def test_a_draped_ring_is_in_balance_and_has_come_down():
    cloth, held = ring()
    simulation, forces = rest.started(Scene(cloth, [attach(cloth, rest.HAND, held)])), Forces(cloth)
    rest.fall(simulation, FALLS)
    fallen = simulation.energy.total - simulation.energy.kinetic
    assert rest.relax(simulation, forces)
    weight = cloth.masses()[:, None] * [0.0, 0.0, -9.81]
    free = np.ones(len(weight), dtype=bool)
    free[held] = False
    # A micrometre of stretch between two of them, at 2,000 N/m, is 2e-3 N: more than a vertex weighs, 7e-4 N.
    assert np.abs((forces(simulation.positions) + weight)[free]).max() < 0.01 * np.abs(weight).max()
    assert simulation.energy.total < fallen


def test_a_cloth_that_needs_more_directions_than_it_is_given_is_told():
    cloth, held = ring()
    simulation = rest.started(Scene(cloth, [attach(cloth, rest.HAND, held)]))
    assert not rest.relax(simulation, Forces(cloth), patience=3)


def test_forces_are_those_of_a_cloth_that_nothing_holds():
    cloth, _ = ring()
    forces = Forces(cloth)
    still = np.column_stack([cloth.pattern, np.zeros(len(cloth.pattern))])
    np.testing.assert_allclose(forces(still), 0.0, atol=1e-9)
    moved = forces(1.01 * still)
    np.testing.assert_allclose(moved.sum(axis=0), 0.0, atol=1e-6)
    # Stretched in all directions it pulls itself together.
    assert float(np.sum(moved * still)) < 0.0
