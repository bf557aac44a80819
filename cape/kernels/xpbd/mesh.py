"""XPBD on any mesh: constraints by colour, no two of one colour sharing a vertex.

Threads share each colour and meet after it. Within a colour the loop stays scalar: gathering 64 constraints into
contiguous scratch, so that square roots and divisions vectorise, gains nothing that fetching them twice does not cost.
"""

from cape.kernels.absent import part, row, typed
from cape.kernels.jit import driver, inlined, kernel
from cape.kernels.team import meet, share
from cape.kernels.xpbd.formulas import TINY, change_of, forget, pull_together, set_gains


@kernel
def stretch_listed(
    first, second, step, damping, tiny, gain, rest, slack, impulse, w, x, y, z, vx, vy, vz
):  # fmt: skip
    """Springs between listed vertices, one after the other."""
    for k in range(first.size):
        pull_together(
            k, first[k], second[k], step, damping, tiny, gain, rest, slack, impulse,
            w, w, x, y, z, x, y, z, vx, vy, vz, vx, vy, vz,
        )  # fmt: skip


@kernel
def bend_listed(vertices, coefficients, time, gain, slack, impulse_x, impulse_y, impulse_z, w, x, y, z, vx, vy, vz):
    """C(p) = sum c_a p_a on four listed vertices (K, 4), along all three coordinates; `time` is h + tau."""
    for k in range(gain.size):
        bend_one(k, vertices, coefficients, time, gain, slack, impulse_x, w, x, vx)
        bend_one(k, vertices, coefficients, time, gain, slack, impulse_y, w, y, vy)
        bend_one(k, vertices, coefficients, time, gain, slack, impulse_z, w, z, vz)


@inlined
def bend_one(k, vertices, coefficients, time, gain, slack, impulse, w, p, v):
    """One bend constraint along one coordinate."""
    a, b, c, d = vertices[k, 0], vertices[k, 1], vertices[k, 2], vertices[k, 3]
    ca, cb, cc, cd = coefficients[k, 0], coefficients[k, 1], coefficients[k, 2], coefficients[k, 3]
    va, vb, vc, vd = v[a], v[b], v[c], v[d]
    bend = ca * (p[a] + time * va) + cb * (p[b] + time * vb) + cc * (p[c] + time * vc) + cd * (p[d] + time * vd)
    change = change_of(gain[k] * bend, k, slack, impulse)
    v[a] = va - change * ca * w[a]
    v[b] = vb - change * cb * w[b]
    v[c] = vc - change * cc * w[c]
    v[d] = vd - change * cd * w[d]


@driver
def prepare_mesh(c, step, damping, bend_damping, team):
    """Set all gains for a step; nothing at all where `c` is None."""
    if c is None:
        return
    prepare_list(c.stretch, step, damping, team)
    prepare_list(c.bend, step, bend_damping, team)
    meet(team)


@driver
def prepare_list(constraints, step, damping, team):
    """Set this thread's share of the gains of some constraints."""
    if constraints is not None:
        time = step if damping is None else step + damping
        lo, hi = share(0, constraints.gain.size, team)
        set_gains(
            step, time, constraints.stiffness[lo:hi], constraints.mobility[lo:hi], constraints.gain[lo:hi],
            part(constraints.slack, lo, hi),
        )  # fmt: skip


@driver
def forget_list(constraints, team):
    """Set this thread's share of the impulses to zero, where they are kept at all."""
    if constraints is not None:
        lo, hi = share(0, constraints.gain.size, team)
        forget(constraints.impulse, lo, hi)


@driver
def stretch_colours(first, second, starts, springs, step, damping, w, s, team):
    """Go through all springs, colour by colour."""
    for colour in range(starts.size - 1):
        lo, hi = share(starts[colour], starts[colour + 1], team)
        stretch_listed(
            first[lo:hi], second[lo:hi], step, damping, typed(TINY, s.x), springs.gain[lo:hi], springs.rest[lo:hi],
            part(springs.slack, lo, hi), part(springs.impulse, lo, hi), w, s.x, s.y, s.z, s.vx, s.vy, s.vz,
        )  # fmt: skip
        meet(team)


@driver
def bend_colours(vertices, coefficients, starts, bends, time, w, s, team):
    """Go through all bend constraints, colour by colour."""
    if bends is not None:
        for colour in range(starts.size - 1):
            lo, hi = share(starts[colour], starts[colour + 1], team)
            bend_listed(
                vertices[lo:hi], coefficients[lo:hi], time, bends.gain[lo:hi], part(bends.slack, lo, hi),
                part(row(bends.impulse, 0), lo, hi), part(row(bends.impulse, 1), lo, hi),
                part(row(bends.impulse, 2), lo, hi), w, s.x, s.y, s.z, s.vx, s.vy, s.vz,
            )  # fmt: skip
            meet(team)


@driver
def solve_mesh(s, c, inverse_mass, iterations, step, damping, bend_damping, team):
    """Change the velocities to those of the step's end, in so many sweeps; nothing at all where `c` is None."""
    if c is None:
        return
    bend_time = step if bend_damping is None else step + bend_damping
    forget_list(c.stretch, team)
    forget_list(c.bend, team)
    meet(team)
    for _ in range(iterations):
        stretch_colours(c.first, c.second, c.starts, c.stretch, step, damping, inverse_mass, s, team)
        bend_colours(c.vertices, c.coefficients, c.bend_starts, c.bend, bend_time, inverse_mass, s, team)
