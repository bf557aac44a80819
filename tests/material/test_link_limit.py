"""Threads of a sewn cloth that stretch no further than their fabric allows.

The kernel also runs with the compiler off: NUMBA_DISABLE_JIT=1.
"""

from dataclasses import replace

import numpy as np
import pytest

from cape import Fabric, Scene, Simulation, SymplecticEuler, attach
from cape.assembly.springs import springs_of
from cape.cloth.cloth import MeshCloth
from cape.cloth.sewing import Panel, sewn
from cape.kernels.solve.link_limit import LimitedLinks, Links, limit_links
from cape.kernels.solve.strain_limit import RETURN
from cape.kernels.state import State
from cape.kernels.team import Team
from tests.support.scenes import every_solver

STEP = 5e-3  # s
FRAME = 1 / 60  # s
ALONG = np.array([2.0, -1.0, 2.0]) / 3.0
# Its own weight, 0.49 N/m where 0.25 m of it is held, would strain it by a quarter there.
SLACKENED = Fabric(density=0.2, stretch=2.0, shear=0.2, bend=0.0, strain_limit=(0.04, 0.02))


def limited(x, v, mass, longest: float) -> State:
    """A chain of vertices (n, 3) after its links, from the first on, were kept from getting too long [m]."""
    places, speeds = (np.array(a, float) for a in (x, v))
    state, count = State(*(np.array(c) for c in (*places.T, *speeds.T))), len(places)
    links = Links(
        np.arange(count - 1, dtype=np.uint32), np.arange(1, count, dtype=np.uint32), np.full(count - 1, longest), count
    )
    limit_links(LimitedLinks(state, 1.0 / np.array(mass, float), links), Team.alone(count), 0, 1, STEP)
    return state


def test_a_mass_on_a_held_link_stops_at_its_end():
    velocity = np.array([3.0, 1.0, 0.5])
    state = limited([np.zeros(3), 0.11 * ALONG], [np.zeros(3), velocity], [np.inf, 0.02], 0.1)
    np.testing.assert_allclose(np.stack(state[:3], axis=1), [np.zeros(3), 0.1 * ALONG], atol=1e-16)
    stopped = velocity - velocity @ ALONG * ALONG
    np.testing.assert_allclose(np.stack(state[3:], axis=1), [np.zeros(3), stopped], atol=1e-15)


def test_one_that_comes_back_keeps_its_velocity_and_a_short_one_is_left_alone():
    velocity = -2.0 * ALONG + [0.0, 2.0, 1.0]
    back = limited([np.zeros(3), 0.11 * ALONG], [np.zeros(3), velocity], [np.inf, 0.02], 0.1)
    np.testing.assert_array_equal(np.stack(back[3:], axis=1)[1], velocity)
    x, v = [np.zeros(3), 0.0999 * ALONG], [np.zeros(3), 5.0 * ALONG]
    short = limited(x, v, [np.inf, 0.02], 0.1)
    np.testing.assert_array_equal(np.stack(short[:3], axis=1), x)
    np.testing.assert_array_equal(np.stack(short[3:], axis=1), v)


def test_a_free_pair_keeps_its_momentum_and_its_center():
    mass, x = np.array([0.01, 0.03]), np.array([[0.3, 0.2, 0.1], [0.42, 0.1, 0.2]])
    v = np.array([[-1.0, 2.0, 0.5], [3.0, -0.5, 0.2]])
    state = limited(x, v, mass, 0.15)
    places, speeds = np.stack(state[:3], axis=1), np.stack(state[3:], axis=1)
    np.testing.assert_allclose(mass @ speeds, mass @ v, rtol=1e-14)
    np.testing.assert_allclose(mass @ places, mass @ x, rtol=1e-14)
    along = (x[1] - x[0]) / np.linalg.norm(x[1] - x[0])
    assert (v[1] - v[0]) @ along > 1.0
    assert (speeds[1] - speeds[0]) @ along == pytest.approx(0.0, abs=1e-14)


def test_a_chain_gives_way_no_faster_than_contact_moves_a_vertex():
    """Two held ends, 0.4 m apart, on either side of a free vertex that sits beside one of them."""
    state = limited([[0, 0, 0], [0.39, 0, 0]], np.zeros((2, 3)), [np.inf, 0.02], 0.1)
    sweeps = 10  # at least
    assert 0.39 - state.x[1] >= min(0.29, sweeps * RETURN * STEP) - 1e-12
    held = limited([[0, 0, 0], [0.4, 0, 0]], np.zeros((2, 3)), [np.inf, np.inf], 0.1)
    np.testing.assert_array_equal(held.x, [0.0, 0.4])


@pytest.fixture(scope="module")
def sheet() -> MeshCloth:
    """A panel of 6 x 5 cells of unlike sizes that hangs in the plane x = 0."""
    across, down = np.meshgrid(np.linspace(0.0, 0.24, 7) ** 1.1, np.linspace(0.0, 0.25, 6))
    flat = Panel(
        places=np.stack([0.0 * across, -across, 1.0 - down], axis=-1),
        threads=np.stack([across, down], axis=-1),
        layers=np.ones((5, 6)),
        regions={"top": np.arange(7)},
    )
    return replace(sewn([flat], fabric=SLACKENED), frame="world")


def strains(cloth: MeshCloth, positions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of threads down the warp, and across."""
    springs = springs_of(cloth)
    threads = springs.measured
    first, second, rest = springs.first[threads], springs.second[threads], springs.rest[threads]
    lengths = np.linalg.norm(positions[second] - positions[first], axis=1)
    upright = np.abs(cloth.positions[second, 2] - cloth.positions[first, 2]) > 1e-6
    return lengths[upright] / rest[upright] - 1.0, lengths[~upright] / rest[~upright] - 1.0


def most_strained(scene: Scene, solver) -> tuple[float, float]:
    """The largest strain of the warp and of the weft in a third of a second, in which it falls and swings back."""
    simulation = Simulation(scene, solver=solver)
    seen = []
    for _ in range(20):
        simulation.step({"hand": (np.zeros(3), [1.0, 0.0, 0.0, 0.0])}, FRAME)
        assert isinstance(scene.cloth, MeshCloth)
        seen.append([each.max() for each in strains(scene.cloth, simulation.positions)])
    warp, weft = np.max(seen, axis=0)
    return float(warp), float(weft)


@every_solver
@pytest.mark.few("euler", "xpbd")
def test_a_cloth_hangs_no_longer_than_its_threads_may_get(sheet: MeshCloth, solver):
    scene = Scene(sheet, [attach(sheet, "hand", "top")], strain_limit=True)
    warp, weft = most_strained(scene, solver)
    # Threads at the top bear the most, and get as long as they may; half a millimetre over a link of 5 cm may be left.
    assert warp == pytest.approx(0.04, abs=0.01)
    assert weft < 0.03
    assert most_strained(replace(scene, strain_limit=False), solver)[0] > 0.2


def test_the_bits_are_the_same_on_one_thread_and_on_two(sheet: MeshCloth):
    scene = Scene(sheet, [attach(sheet, "hand", "top")], strain_limit=True)
    pose = {"hand": (np.zeros(3), [1.0, 0.0, 0.0, 0.0])}
    ended = []
    for threads in (1, 2):
        simulation = Simulation(scene, solver=SymplecticEuler(), threads=threads)
        for _ in range(5):
            simulation.step(pose, FRAME)
        ended.append(simulation.positions)
    np.testing.assert_array_equal(ended[0], ended[1])


def test_only_threads_are_limited_and_only_they_are_measured(sheet: MeshCloth):
    springs = springs_of(sheet)
    ends = sheet.positions[springs.second] - sheet.positions[springs.first]
    aligned = (np.abs(ends) > 1e-9).sum(axis=1) == 1
    np.testing.assert_array_equal(springs.measured[aligned], True)
    np.testing.assert_array_equal(springs.measured[~aligned], False)


def test_what_limits_a_mesh_is_in_its_program_only_where_it_is_asked_for(sheet: MeshCloth):
    asked = []
    for limit in (False, True):
        simulation = Simulation(Scene(sheet, [attach(sheet, "hand", "top")], strain_limit=limit))
        asked.append({request.name for request in simulation.requests({"hand": (np.zeros(3), [1.0, 0.0, 0.0, 0.0])})})
    assert asked[1] - asked[0] == {"limit_links"}
