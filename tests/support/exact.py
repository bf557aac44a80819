"""The semi-discrete model of a grid of cloth that nothing touches, integrated by scipy with force code of its own.

M x'' = f(x, x', t) with the masses and springs that a scene was assembled to, and held vertices that move as told.
"""

from collections.abc import Sequence
from itertools import pairwise

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from cape.assembly.assemble import Assembly

FloatArray = NDArray[np.float64]


@numba.njit(cache=True)
def add_forces(x, v, out, first, second, stiffness, rest, damping, members, shares, bend_stiffness, bend_damping):
    """Add the forces of springs and bend springs [N] to `out`, shape (V, 3), of vertices at x [m], v [m/s]."""
    for e in range(first.size):
        i, j = first[e], second[e]
        ax, ay, az = x[j, 0] - x[i, 0], x[j, 1] - x[i, 1], x[j, 2] - x[i, 2]
        length = np.sqrt(ax * ax + ay * ay + az * az)
        rate = ((v[j, 0] - v[i, 0]) * ax + (v[j, 1] - v[i, 1]) * ay + (v[j, 2] - v[i, 2]) * az) / length
        pull = stiffness[e] * (length - rest[e] + damping * rate) / length
        out[i, 0] += pull * ax
        out[i, 1] += pull * ay
        out[i, 2] += pull * az
        out[j, 0] -= pull * ax
        out[j, 1] -= pull * ay
        out[j, 2] -= pull * az
    for k in range(bend_stiffness.size):
        for c in range(3):
            bent = 0.0
            for a in range(4):
                bent += shares[k, a] * (x[members[k, a], c] + bend_damping * v[members[k, a], c])
            for a in range(4):
                out[members[k, a], c] -= bend_stiffness[k] * shares[k, a] * bent


class ExactModel:
    """A cloth as a system of ordinary differential equations, vertices numbered as in the assembly."""

    def __init__(self, assembly: Assembly) -> None:
        s, fabric = assembly.springs, assembly.cloth.fabric
        self._links = (
            s.first, s.second, s.stiffness, s.rest, fabric.damping_time,
            s.bend_vertices, s.bend_coefficients, s.bend_stiffness, fabric.bend_damping_time,
        )  # fmt: skip
        self._inverse_mass = assembly.inverse_mass[:, None]
        self._falling = np.array(assembly.scene.gravity) * (self._inverse_mass > 0.0)
        self._held = assembly.inverse_mass == 0.0

    def rates(self, _: float, y: FloatArray) -> FloatArray:
        """Velocities [m/s] and accelerations [m/s2] of positions and velocities, shape (2 V 3,)."""
        x, v = y.reshape(2, -1, 3)
        force = np.zeros_like(x)
        add_forces(x, v, force, *self._links)
        return np.concatenate([v.ravel(), (self._falling + self._inverse_mass * force).ravel()])

    def motion(
        self,
        x: FloatArray,
        v: FloatArray,
        rod: Sequence[FloatArray],
        frame: float,
        *,
        relative: float = 1e-6,
        absolute: float = 1e-9,
    ) -> FloatArray:
        """Positions [m] at the end of each frame of a length [s], shape (F, V, 3).

        The cloth sets out at x [m] and v [m/s], shape (V, 3); what holds it moves evenly from each of F + 1 places of
        the rod [m] to the next. `relative` and `absolute` [m, m/s] are the tolerances of a step, by the method of order
        8 of Dormand and Prince.
        """
        taken, step = [], None
        for before, after in pairwise(rod):
            v = np.where(self._held[:, None], (after - before) / frame, v)
            found = solve_ivp(
                self.rates, (0.0, frame), np.concatenate([x.ravel(), v.ravel()]), method="DOP853",
                rtol=relative, atol=absolute, first_step=step,
            )  # fmt: skip
            x, v = found.y[:, -1].reshape(2, -1, 3)
            step = min(float(np.diff(found.t).max()), frame)
            taken.append(x)
        return np.array(taken)
