"""A state in double precision, corrected on a copy in single: contact is then compiled for one precision alone.

A solver that needs all digits to solve for a step needs none of the last ones to be stopped at a limb, or at another
layer: there thicknesses are millimetres, and single precision has a tenth of a micrometre a metre from the origin. What
the copy is changed by is added to the state, so that vertices which nothing stops or draws keep all their digits.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.contact.drawn import copy
from cape.kernels.jit import kernel, unit
from cape.kernels.state import State


class Rounded(NamedTuple):
    """A `state` in double precision, and its `copy` in single."""

    state: State
    copy: State


class RoundedPlaces(NamedTuple):
    """Where vertices are [m] (at least 3, N), in double precision, and the `copy` of that in single (3, N)."""

    places: NDArray[np.floating]
    copy: NDArray[np.floating]


@unit
def round_state(g, team, substep, substeps, step):
    """Make the copy of a thread's vertices anew."""
    s, c, lo, hi = g.state, g.copy, team.lo, team.hi
    copy(s.x[lo:hi], s.y[lo:hi], s.z[lo:hi], c.x[lo:hi], c.y[lo:hi], c.z[lo:hi])
    copy(s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi], c.vx[lo:hi], c.vy[lo:hi], c.vz[lo:hi])


@unit
def round_places(g, team, substep, substeps, step):
    """Make the copy of where a thread's vertices are anew."""
    p, c, lo, hi = g.places, g.copy, team.lo, team.hi
    copy(p[0, lo:hi], p[1, lo:hi], p[2, lo:hi], c[0, lo:hi], c[1, lo:hi], c[2, lo:hi])


@unit
def add_changes(g, team, substep, substeps, step):
    """Add what the copy of a thread's vertices has changed by to their state."""
    s, c, lo, hi = g.state, g.copy, team.lo, team.hi
    add_change(s.x[lo:hi], s.y[lo:hi], s.z[lo:hi], c.x[lo:hi], c.y[lo:hi], c.z[lo:hi])
    add_change(s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi], c.vx[lo:hi], c.vy[lo:hi], c.vz[lo:hi])


@kernel
def add_change(x, y, z, new_x, new_y, new_z):
    """Add to numbers what their rounded copies have changed by since."""
    number = new_x.dtype.type
    for i in range(x.size):
        x[i] += np.float64(new_x[i]) - np.float64(number(x[i]))
        y[i] += np.float64(new_y[i]) - np.float64(number(y[i]))
        z[i] += np.float64(new_z[i]) - np.float64(number(z[i]))
