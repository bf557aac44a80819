"""The heavy elastica: a strip clamped level at one end that bends under its own weight, however far.

At the distance s from the clamp, with the slope theta below the horizontal, moments balance where

    B theta''(s) = -W g (L - s) cos(theta),  theta(0) = 0,  theta'(L) = 0

for a rigidity B [N m], a weight per area W g [N/m2] and a length L [m] (by algebra here, B theta' being the
moment of the weight beyond s about the point there; Bickley 1934 named the curve, "The heavy elastica", Philosophical
Magazine 17). With lengths in units of L there is a single parameter, the load W g L^3 / B.
"""

import math
from functools import cache

import numpy as np

HEAVIEST = 200.0  # load up to which an angle is looked for


def tip(load: float) -> tuple[float, float]:
    """Where the free end is, from the clamp: how far out and how far down, as shares of the length.

    Args:
        load: W g L^3 / B, more than 0.
    """
    from scipy.integrate import solve_bvp

    def slopes(s: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.stack([y[1], -load * (1.0 - s) * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])])

    def ends(clamp: np.ndarray, free: np.ndarray) -> np.ndarray:
        return np.array([clamp[0], free[1], clamp[2], clamp[3]])

    s = np.linspace(0.0, 1.0, 41)
    # The slope of a beam that bends little, kept below a right angle.
    slope = load / 6.0 * (1.0 - (1.0 - s) ** 3) / (1.0 + load / 6.0)
    found = solve_bvp(slopes, ends, s, np.stack([slope, 0.0 * s, s, 0.0 * s]), tol=1e-8, max_nodes=10_000)
    return float(found.y[2, -1]), float(found.y[3, -1])


def chord_angle(load: float) -> float:
    """Angle between the horizontal and the line from the clamp to the free end [degrees]."""
    out, down = tip(load)
    return math.degrees(math.atan2(down, out))


@cache
def load_at(angle: float) -> float:
    """The load W g L^3 / B at which the chord is at an angle below the horizontal [degrees], up to some 80."""
    from scipy.optimize import brentq

    result = brentq(lambda load: chord_angle(load) - angle, 1e-3, HEAVIEST, xtol=1e-7)
    return float(result)  # pyright: ignore[reportArgumentType]


def length_at(angle: float, *, density: float, bend: float, gravity: float) -> float:
    """Length that hangs over where the chord is at an angle [degrees], in metres.

    Args:
        angle: below the horizontal [degrees].
        density: mass per area [kg/m2].
        bend: bending moment per width and curvature [N m].
        gravity: [m/s2].
    """
    return (load_at(angle) * bend / (density * gravity)) ** (1.0 / 3.0)
