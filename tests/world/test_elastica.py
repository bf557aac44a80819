"""The heavy elastica against the beam that bends little, shooting from its free end, and the standard's rule."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from cape.report.measured.world import elastica


@pytest.mark.parametrize("load", [1e-3, 1e-2, 0.1])
def test_a_light_load_bends_it_as_a_beam(load: float):
    out, down = elastica.tip(load)
    # The next term is of the square of the slope, load / 6: 9/20 of it at most where cos and chord are expanded.
    assert down == pytest.approx(load / 8.0, rel=(load / 6.0) ** 2 + 1e-7)
    assert out == pytest.approx(1.0, abs=(load / 6.0) ** 2)


@pytest.mark.parametrize("angle", [20.0, 50.0, 75.0])
def test_shooting_from_the_free_end_finds_the_same_curve(angle: float):
    """From a free end at a slope t0 with lengths in units of (B / W g)^(1/3): t'' = -r cos t, r the way from it.

    It is a cantilever from wherever it becomes level; the length up to there, cubed, is the load.
    """

    def slopes(r: float, y: np.ndarray) -> list[float]:
        return [y[1], -r * math.cos(y[0]), math.cos(y[0]), math.sin(y[0])]

    def level(r: float, y: np.ndarray) -> float:
        return y[0]

    level.terminal = True  # pyright: ignore[reportFunctionMemberAccess]
    found = solve_ivp(
        slopes, (0.0, 20.0), [math.radians(angle), 0.0, 0.0, 0.0], "DOP853", events=level, rtol=1e-11, atol=1e-12
    )
    length = found.t[-1]
    out, down = elastica.tip(length**3)
    assert out == pytest.approx(found.y[2, -1] / length, abs=1e-7)
    assert down == pytest.approx(found.y[3, -1] / length, abs=1e-7)


def test_the_standard_s_angle_is_where_the_bending_length_is_half_of_the_overhang():
    """ASTM D1388 takes (B / W g)^(1/3) for half of the overhang: a load of 8, to the digits that it has."""
    assert elastica.load_at(41.5) == pytest.approx(8.0, rel=1e-3)
    assert elastica.chord_angle(elastica.load_at(41.5)) == pytest.approx(41.5, abs=1e-6)


def test_a_fabric_s_overhang_follows_from_its_load():
    length = elastica.length_at(41.5, density=0.2, bend=1e-5, gravity=9.81)
    assert 0.2 * 9.81 * length**3 / 1e-5 == pytest.approx(elastica.load_at(41.5), rel=1e-12)
