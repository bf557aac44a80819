"""Threads of a mesh that stretch no further than their fabric allows.

What is done to each is what `kernels.solve.strain_limit` does to those of a grid, after the same sources. A mesh has no
rows in which threads lie side by side: they are taken one after another, from where the cloth is held outwards, so that
one sweep takes a tug to the hem, by one thread of the team alone.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.fused import fused
from cape.kernels.jit import kernel, routine, unit
from cape.kernels.solve.strain_limit import RETURN, SLACK, sweeps_over
from cape.kernels.state import State

Array = NDArray[np.floating]


class Links(NamedTuple):
    """Links of threads in the order in which they are shortened: vertices `first` and `second` (n,), and how long each
    may get, `longest` [m] (n,). `chain` is how many lead from where the cloth is held to its farthest vertex."""

    first: NDArray[np.uint32]
    second: NDArray[np.uint32]
    longest: Array
    chain: int


class LimitedLinks(NamedTuple):
    """A cloth whose `links` are limited; `inverse_mass` [1/kg] (N,) is zero for attached vertices."""

    state: State
    inverse_mass: Array
    links: Links


@unit
def limit_links(g, team, substep, substeps, step):
    """Keep links of threads from getting too long."""
    keep_short(g, g.links.longest.size, step)


@routine
def keep_short(g, count, step):
    """Shorten the first links of a cloth, so many, in turn until none of them is too long."""
    s, links = g.state, g.links
    for _ in range(sweeps_over(links.chain, step)):
        if not shorten_links(
            s.x, s.y, s.z, s.vx, s.vy, s.vz, g.inverse_mass, links.first[:count], links.second[:count],
            links.longest[:count], RETURN * step,
        ):  # fmt: skip
            break


@kernel
def shorten_links(x, y, z, vx, vy, vz, w, first, second, longest, most):
    """Bring links that are longer than their longest [m] back to that, and stop their stretching; whether there were.

    Each is shortened by at most `most` [m]. What two held ends stretch stays as it is.
    """
    number = longest.dtype.type
    bound, one, none, far = number((1.0 + SLACK) ** 2), number(1.0), number(0.0), number(most)
    found = False
    for k in range(longest.size):
        i, j = first[k], second[k]
        dx, dy, dz = x[j] - x[i], y[j] - y[i], z[j] - z[i]
        squared, both = dx * dx + dy * dy + dz * dz, w[i] + w[j]
        if squared <= bound * (longest[k] * longest[k]) or both <= none:
            continue
        found = True
        length = math.sqrt(squared)
        parting = max((vx[j] - vx[i]) * dx + (vy[j] - vy[i]) * dy + (vz[j] - vz[i]) * dz, none) / length
        # Of each end for its inverse mass, per length along the thread.
        scale = one / (both * length)
        moved, slowed = scale * min(length - longest[k], far), scale * parting
        m0, m1, s0, s1 = w[i] * moved, -w[j] * moved, w[i] * slowed, -w[j] * slowed
        x[i], y[i], z[i] = fused(m0, dx, x[i]), fused(m0, dy, y[i]), fused(m0, dz, z[i])
        x[j], y[j], z[j] = fused(m1, dx, x[j]), fused(m1, dy, y[j]), fused(m1, dz, z[j])
        vx[i], vy[i], vz[i] = fused(s0, dx, vx[i]), fused(s0, dy, vy[i]), fused(s0, dz, vz[i])
        vx[j], vy[j], vz[j] = fused(s1, dx, vx[j]), fused(s1, dy, vy[j]), fused(s1, dz, vz[j])
    return found
