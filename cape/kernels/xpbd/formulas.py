"""What one XPBD constraint does to the velocities of its vertices.

Macklin, Mueller, Chentanez 2016, "XPBD", eq. 26, gives the change of a constraint's multiplier as

    d lambda = (-C - a lambda - g grad C (x - x_n)) / ((1 + g) sum w |grad C|^2 + a),  a = 1 / (k h^2),  g = tau / h

for stiffness k, damping time tau and step h. Here the unknown of a step is not the position but the velocity that takes
the vertices there, x = x_n + h v: the same corrections divided by h. Positions then change once per step, and
corrections far below the last digit of a position are not lost. With the impulse p = -lambda / h and times k h^2,

    d p = gain (C + tau dC/dt) - slack p,  gain = h k slack,  slack = 1 / (1 + h k (h + tau) sum w |grad C|^2)

and without any impulse yet, as in the one sweep per step of Macklin et al. 2019, "Small steps", the last term is none.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.fused import fused
from cape.kernels.jit import inlined, kernel, routine

Array = NDArray[np.floating]

TINY = 1e-18  # m2, keeps a spring of zero length from dividing by zero


class Constraints(NamedTuple):
    """E XPBD constraints, in any arrangement: stiffness [N/m], rest length [m] (None for bend springs), the sum of
    w |grad C|^2 [1/kg], room for the gains [N s/m] of a step; and where a step has several sweeps, for what share of an
    impulse a sweep gives up and for the impulses [N s], of bend springs along all three axes."""

    stiffness: Array
    rest: Array | None
    mobility: Array
    gain: Array
    slack: Array | None
    impulse: Array | None


@kernel
def set_gains(step, time, stiffness, mobility, gain, slack):
    """Fill `gain` and, unless it is None, `slack`; `step` is h, `time` h + tau, `mobility` the sum w |grad C|^2."""
    for k in range(gain.size):
        pull = step * stiffness[k]
        share = 1 / (1 + pull * time * mobility[k])
        gain[k] = pull * share
        if slack is not None:
            slack[k] = share


@inlined
def bend_time(step, damping):
    """h + tau."""
    if damping is None:
        return step
    return step + damping


@routine
def forget(impulse, lo, hi):
    """Set impulses to zero, along the last axis; nothing for None."""
    if impulse is not None:
        impulse[..., lo:hi] = 0


@inlined
def change_of(wanted, k, slack, impulse):
    """What is added to the impulse of constraint k, whose gain alone would add `wanted`; keeps the sum."""
    if impulse is None:
        return wanted
    change = fused(-slack[k], impulse[k], wanted)
    impulse[k] += change
    return change


@inlined
def pulled(k, dx, dy, dz, ux, uy, uz, damping, tiny, gain, rest, slack, impulse):
    """What spring k adds to the impulse along (dx, dy, dz), which it has at the step's end, of ends that move apart
    with (ux, uy, uz); `damping` [s] or None."""
    squared = fused(dx, dx, fused(dy, dy, fused(dz, dz, tiny)))
    length = math.sqrt(squared)
    stretch = fused(-rest[k], length, squared)
    if damping is not None:
        stretch = fused(damping, fused(ux, dx, fused(uy, dy, uz * dz)), stretch)
    if impulse is None:
        scale = gain[k] * stretch / squared
    else:
        scale = change_of(gain[k] * stretch / length, k, slack, impulse) / length
    return scale


@inlined
def pull_together(
    k,
    i,
    j,
    step,
    damping,
    tiny,
    gain,
    rest,
    slack,
    impulse,
    w0,
    w1,
    x0,
    y0,
    z0,
    x1,
    y1,
    z1,
    vx0,
    vy0,
    vz0,
    vx1,
    vy1,
    vz1,
):
    """C(x) = |x1 - x0| - l0 between vertex i of one group of arrays and j of the other; `damping` [s] or None."""
    ax, ay, az, bx, by, bz = vx0[i], vy0[i], vz0[i], vx1[j], vy1[j], vz1[j]
    ux, uy, uz = bx - ax, by - ay, bz - az
    dx, dy, dz = fused(step, ux, x1[j] - x0[i]), fused(step, uy, y1[j] - y0[i]), fused(step, uz, z1[j] - z0[i])
    scale = pulled(k, dx, dy, dz, ux, uy, uz, damping, tiny, gain, rest, slack, impulse)
    a, b = scale * w0[i], scale * w1[j]
    vx0[i], vy0[i], vz0[i] = fused(a, dx, ax), fused(a, dy, ay), fused(a, dz, az)
    vx1[j], vy1[j], vz1[j] = fused(-b, dx, bx), fused(-b, dy, by), fused(-b, dz, bz)


@inlined
def draw_to_middle(k, i, j, l, time, gain, slack, impulse, w0, w1, w2, p0, p1, p2, v0, v1, v2):  # noqa: E741
    """C(p) = p0 - 2 p1 + p2 along one coordinate, of vertices i, j and l of three groups; `time` is h + tau."""
    a, b, c = v0[i], v1[j], v2[l]
    bend = fused(time, a - b - b + c, p0[i] - p1[j] - p1[j] + p2[l])
    change = change_of(gain[k] * bend, k, slack, impulse)
    v0[i] = fused(-change, w0[i], a)
    v1[j] = fused(change + change, w1[j], b)
    v2[l] = fused(-change, w2[l], c)


@inlined
def straighten_cell(
    i, j, m, n, time, gain, slack, impulse, w00, w10, w01, w11, p00, p10, p01, p11, v00, v10, v01, v11
):  # fmt: skip
    """C(p) = p00 - p10 - p01 + p11 along one coordinate, of vertices i, j, m and n of four groups, which is constraint
    i; `time` is h + tau."""
    a, b, c, d = v00[i], v10[j], v01[m], v11[n]
    twist = fused(time, (d - c) - (b - a), (p11[n] - p01[m]) - (p10[j] - p00[i]))
    change = change_of(gain[i] * twist, i, slack, impulse)
    v00[i] = fused(-change, w00[i], a)
    v10[j] = fused(change, w10[j], b)
    v01[m] = fused(change, w01[m], c)
    v11[n] = fused(-change, w11[n], d)


@inlined
def unsigned(number):
    """An index that can't be negative: signed ones that do not start at 0 keep a loop scalar."""
    return np.uint64(number)
