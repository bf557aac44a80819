"""Cantilever, tension, shear and pendulum: what the machinery finds on a grid, against closed forms."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

from cape import FABRICS, Fabric, Scene, attach
from cape.report.measured.world import cantilever, pendulum, stretch
from cape.report.measured.world.forces import Forces
from cape.report.measured.world.pieces import strip_of
from cape.report.measured.world.rest import HAND, relax, started
from tests.support.scenes import grid_cloth


def test_a_strip_is_brought_to_the_rest_of_its_own_weight():
    fabric = Fabric(density=0.2, stretch=60.0, shear=0.0, bend=0.0)
    cloth = grid_cloth([0.0, 0.1, 0.2], np.linspace(0.0, 1.0, 11), fabric)
    simulation = started(Scene(cloth, [attach(cloth, HAND, [0, 1, 2])]))
    assert relax(simulation, Forces(cloth))
    # The midpoint rule sums the tension exactly. It is as far from there as a Newton step leads, a micrometre at most.
    assert -simulation.positions[-2, 2] - 1.0 == pytest.approx(0.2 * 9.81 / (2.0 * 60.0), abs=1e-6)


@pytest.mark.parametrize(("name", "direction"), [("worsted", "warp"), ("tablecloth", "weft")])
def test_a_fabric_hangs_over_as_far_as_the_heavy_elastica(name: str, direction: str):
    row = cantilever.measure(name, direction, "grid")
    assert row.result == "finished"
    fabric = FABRICS[name]
    bend = fabric.bend_warp if direction == "warp" else fabric.bend_weft
    assert row.expected == pytest.approx(1e3 * (8.0042 * bend / (fabric.density * 9.81)) ** (1 / 3), rel=1e-5)
    # Second differences and lumped weights are of second order in the cells, of which there are 16 along the overhang.
    assert row.simulated == pytest.approx(row.expected, rel=1.0 / cantilever.CELLS**2)
    assert row.verdict == "passes"


@pytest.mark.extra
@pytest.mark.parametrize("direction", ["warp", "weft"])
@pytest.mark.parametrize("name", FABRICS)
def test_every_fabric_hangs_over_as_far_as_the_heavy_elastica(name: str, direction: str):
    row = cantilever.measure(name, direction, "grid")
    # As above; soft knits also stretch, by less than a thousandth.
    assert row.simulated == pytest.approx(row.expected, rel=1.0 / cantilever.CELLS**2 + 1e-3)


@pytest.mark.parametrize("direction", ["warp", "weft", "bias"])
@pytest.mark.parametrize("variant", ["grid", "equilateral"])
def test_strips_lie_along_their_direction(direction: str, variant: str):
    if (variant, direction) == ("grid", "bias"):
        return
    cloth = strip_of(Fabric(), direction, variant, 0.3, 0.025, 4)
    x, y = cloth.positions[:, 0], cloth.positions[:, 1]
    along = {"warp": [0.0, 1.0], "weft": [1.0, 0.0], "bias": [math.sqrt(0.5), math.sqrt(0.5)]}[direction]
    np.testing.assert_allclose(cloth.pattern @ along, x, atol=1e-12)
    np.testing.assert_allclose(np.abs(cloth.pattern @ [-along[1], along[0]]), y, atol=1e-12)


@pytest.mark.parametrize("direction", ["warp", "weft"])
def test_a_pulled_strip_resists_and_narrows_as_its_fabric_says(direction: str):
    stiffness, narrowing = stretch.tension("swim", direction, "grid")
    fabric = FABRICS["swim"]
    pulled, across = fabric.stretch_warp, fabric.stretch_weft
    if direction == "weft":
        pulled, across = across, pulled
    # Terms of second order in the strain; those of grips fade over a third of the strip.
    assert stiffness.simulated == pytest.approx(pulled - fabric.shear**2 / across, rel=2.0 * stretch.STRAIN)
    assert narrowing.simulated == pytest.approx(fabric.shear / across, rel=4.0 * stretch.STRAIN)


def test_a_sheared_square_resists_as_its_fabric_says():
    row = stretch.shear("worsted", "grid")
    assert row.simulated == pytest.approx(FABRICS["worsted"].shear, rel=2.0 * stretch.STRAIN)


@pytest.mark.parametrize(("direction", "angle"), [("weft", 0.0), ("bias", 45.0), ("warp", 90.0)])
def test_the_expected_stiffness_is_the_least_energy_of_a_strip_free_to_narrow(direction: str, angle: float):
    """Numerically: the energy of a unit strain along the direction, least over strains across and shears."""
    fabric = FABRICS["swim"]
    plane = stretch.plane_of(fabric)
    c, s = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    turn = np.array([[c, -s], [s, c]])
    energy = np.zeros((3, 3))
    modes = [np.diag([1.0, 0.0]), np.diag([0.0, 1.0]), np.array([[0.0, 0.5], [0.5, 0.0]])]
    strains = [turn @ mode @ turn.T for mode in modes]
    for i, one in enumerate(strains):
        for j, other in enumerate(strains):
            energy[i, j] = (
                plane.c11 * one[0, 0] * other[0, 0] + plane.c22 * one[1, 1] * other[1, 1]
                + plane.c12 * (one[0, 0] * other[1, 1] + one[1, 1] * other[0, 0])
                + 4.0 * plane.shear * one[0, 1] * other[0, 1]
            )  # fmt: skip
    free = -np.linalg.solve(energy[1:, 1:], energy[1:, 0])
    expected = energy[0, 0] + energy[0, 1:] @ free, -free[0]
    assert stretch._expected(fabric, direction) == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("angle", pendulum.ANGLES)
def test_a_pendulum_s_period_is_that_of_energy_s_integral(angle: float):
    """T = 4 sqrt(l / 2 g) times the integral of dt / sqrt(cos t - cos t0), with t = t0 sin u to take away its pole."""
    cloth = pendulum._strip(math.radians(angle))
    masses, radii = cloth.masses(), cloth.pattern[:, 1]
    length, top = masses @ radii**2 / (masses @ radii), math.radians(angle)

    def slowness(u: float) -> float:
        return top * math.cos(u) / math.sqrt(math.cos(top * math.sin(u)) - math.cos(top))

    quarter = math.sqrt(length / 9.81 / 2.0) * quad(slowness, 0.0, math.pi / 2.0 - 1e-9)[0]
    assert pendulum._expected(cloth, top) == pytest.approx(4.0 * quarter, rel=1e-6)


def test_periods_are_read_between_frames():
    times = pendulum.FRAME * np.arange(200)
    for period in (1.0, 0.937):
        assert pendulum.period_of(np.cos(2.0 * math.pi * times / period)) == pytest.approx(period, rel=1e-5)
    assert math.isnan(pendulum.period_of(np.ones(10)))


@pytest.mark.parametrize("solver", ["euler", "tr_bdf2"])
def test_a_stiff_strip_swings_from_far_out_as_a_pendulum(solver: str):
    row = pendulum.measure(150.0, solver)
    # Steps of h = 65 us with w about 7 per s: symplectic Euler's first quarter is off by half a step, of 0.4 s.
    assert row.simulated == pytest.approx(row.expected, rel=3e-4 if solver == "euler" else 5e-5)
