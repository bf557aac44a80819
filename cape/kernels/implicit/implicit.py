"""Implicit steps: backward Euler and TR-BDF2.

Every stage finds positions x with v = (x - xt) / b and M (v - vt) / b = f(x, v) + M g:

    backward Euler   b = h,  xt = x0,  vt = v0
    TR-BDF2          b = gamma h / 2,  gamma = 2 - 2^1/2, for both stages
      to t + gamma h   xt = x0 + b v0,  vt = v0 + b a0        trapezoidal rule, a0 the acceleration at the start
      to t + h         xt = c1 x1 - c0 x0,  vt = c1 v1 - c0 v0,  c1 = 1 / (gamma (2 - gamma)),  c0 = c1 - 1

Bank et al. 1985, "Transient simulation of silicon devices and circuits"; Hosea and Shampine 1996, "Analysis and
implementation of TR-BDF2"; see `accelerations` for a0.

Newton's method with a line search on the directional derivative alone, since neither damping, air nor friction has an
energy: a step is taken unless the derivative changes sign and is nearly as large as before (the curvature condition of
Nocedal and Wright 2006, eq. 3.7b); otherwise the secant leads towards its zero.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.bones import Motion, MotionRoom
from cape.kernels.contact.penalty import SLIP
from cape.kernels.implicit.conjugate_gradients import dot_terms, largest_of_all, solve_unless, sum_all
from cape.kernels.implicit.stages import (
    begin_bdf2,
    begin_euler,
    begin_trapezoid,
    follow,
    longest,
    longest_share,
    move,
    place_at,
    subtract_inertia,
)
from cape.kernels.implicit.stiffness import Matrix, copy
from cape.kernels.jit import inlined, routine, unit
from cape.kernels.program import Program, run
from cape.kernels.solve.attachments import Attached, hold_rigidly
from cape.kernels.state import Inertia, State
from cape.kernels.team import meet

Array = NDArray[np.floating]

GAMMA = 2.0 - math.sqrt(2.0)
BACK = 0.9  # share of the first directional derivative up to which a step may overshoot
TRIES = 6  # of the line search
NARROWEST, WIDEST = 0.1, 0.9  # share of the step at hand that the next try takes
GUARD = 0.5  # share of the thickness that a step's end leaves free where contact forces did not
EXACT = 0.1  # share of SLIP to which velocities are solved where contact presses: less costs iterations
SLOPE, FIRST = 0, 1  # what is known of a Newton step, see `System`
UNSOLVED, NEWTON, LINEAR, SHORTENED = 0, 1, 2, 3  # what is counted: stages not solved, iterations, shortened steps


class Work(NamedTuple):
    """Room that threads share: stage data (6, N), positions before a Newton step (3, N), forces (3, N), and sums."""

    start: Array
    target: Array
    old: Array
    acceleration: Array
    forces: Array
    terms: Array
    sums: Array
    largest: Array


class Settings(NamedTuple):
    """See `ImplicitSolver`; the tolerance is for steps that are solved with a b of `usual` [s] or more.

    In shorter ones it shrinks as their `power`, and the forcing as its own. Linear systems may be solved `closely`,
    until vertices are moved by less than the tolerance, root mean square, which is then for what a Newton step leaves,
    not for the step.
    `digits` is the share of a coordinate below which steps are rounding.
    """

    tolerance: float
    power: int
    closely: bool
    usual: float
    digits: float
    iterations: int
    forcing: float
    forcing_power: int
    linear_iterations: int


class System(NamedTuple):
    """The equations of a stage.

    Four programs make them up: `residual` sets all forces but inertia, `linearise` the matrix at the state that these
    have just been set for, `product` is the matrix times a vector, `precondition` what is added to the residual times
    the inverse of its block diagonal, of no unit where nothing is. `counts` (4,) and `found` (2,) are a thread's own:
    minus the directional derivative along a Newton step [J], and how far the first step towards it goes, as a share of
    the tolerance.
    """

    state: State
    inertia: Inertia
    matrix: Matrix
    work: Work
    settings: Settings
    counts: NDArray[np.int64]
    found: NDArray[np.float64]
    residual: Program
    linearise: Program
    product: Program
    precondition: Program


class Problem(NamedTuple):
    """A system and the programs that solve it: `evaluate` finds its residual, `aim` a Newton step, and `again` one with
    the matrix at hand.

    `pressing` (3, N) are the forces of contact [N], of no vertices where nothing presses.
    """

    system: System
    evaluate: Program
    aim: Program
    again: Program
    pressing: Array


class Stage(NamedTuple):
    """A stage whose b is a `share` of the step."""

    problem: Problem
    share: float


class Placing(NamedTuple):
    """Bones to be placed at a time within a step, as a share `at` of it."""

    motion: Motion
    bones: MotionRoom
    at: float


class Holding(NamedTuple):
    """What bones hold, to be placed at that time, for a stage whose b is a `share` of the step and which aims at
    `target` (6, N)."""

    state: State
    attached: Attached
    bones: MotionRoom
    target: Array
    at: float
    share: float


@unit
def evaluate(g, team, substep, substeps, b):
    """Set velocities, forces and the residual that belong to the positions of a thread's vertices."""
    s, work, inertia, lo, hi = g.state, g.work, g.inertia, team.lo, team.hi
    dtype = s.x.dtype.type
    rate, gravity = dtype(1.0 / b), inertia.gravity
    t, f, r = work.target, work.forces, g.matrix.vectors[1]
    a, e = g.matrix.front + lo, g.matrix.front + hi
    follow(
        rate, t[0, lo:hi], t[1, lo:hi], t[2, lo:hi], s.x[lo:hi], s.y[lo:hi], s.z[lo:hi],
        s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi],
    )  # fmt: skip
    meet(team)
    run(g.residual, team, substep, 1, b)
    subtract_inertia(
        rate, dtype(gravity[0]), dtype(gravity[1]), dtype(gravity[2]), inertia.free[lo:hi], inertia.mass[lo:hi],
        t[3, lo:hi], t[4, lo:hi], t[5, lo:hi], s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi],
        f[0, lo:hi], f[1, lo:hi], f[2, lo:hi], r[0, a:e], r[1, a:e], r[2, a:e],
    )  # fmt: skip


@unit
def aim_newton_step(g, team, substep, substeps, b):
    """Linearise at the state and solve for a Newton step, of which `substep` says how many have been taken."""
    run(g.linearise, team, 0, 1, b)
    solve_for_step(g, b, substep > 0, team)


@unit
def aim_again(g, team, substep, substeps, b):
    """Solve for a step with the matrix at hand."""
    solve_for_step(g, b, True, team)


@routine
def solve_for_step(g, b, settled, team):
    """Solve the linear system of a Newton step, unless the stage may be `settled`, and note what is known of it."""
    settings = g.settings
    forcing = settings.forcing * shortness(settings, b, settings.forcing_power)
    tolerance = tolerance_of(settings, b) if settings.closely else 0.0
    iterations, slope, first = solve_unless(g, b, forcing, tolerance, settled, team)
    g.counts[LINEAR] += iterations
    g.found[SLOPE], g.found[FIRST] = slope, first


@inlined
def tolerance_of(settings, b):
    """What may be left to correct in a stage [m]."""
    return settings.tolerance * shortness(settings, b, settings.power)


@routine
def shortness(settings, b, power):
    """A power of how much shorter b is than what is usual, by squaring: numba's own takes long to compile."""
    share, result = min(1.0, b / settings.usual), 1.0
    while power > 0:
        if power & 1 == 1:
            result *= share
        power >>= 1
        share *= share
    return result


@routine
def step_along(lo, hi, share, system):
    """Move the vertices lo to hi a share of the Newton step from where it began."""
    s, o, d = system.state, system.work.old, system.matrix.vectors[0]
    a, e = system.matrix.front + lo, system.matrix.front + hi
    move(
        s.x.dtype.type(share), o[0, lo:hi], o[1, lo:hi], o[2, lo:hi], d[0, a:e], d[1, a:e], d[2, a:e],
        s.x[lo:hi], s.y[lo:hi], s.z[lo:hi],
    )  # fmt: skip


@routine
def slope_here(lo, hi, system, team):
    """Minus the directional derivative along the Newton step at the current residual [J]."""
    work, front = system.work, system.matrix.front
    d, r, a, e = system.matrix.vectors[0], system.matrix.vectors[1], front + lo, front + hi
    dot_terms(d[0, a:e], d[1, a:e], d[2, a:e], r[0, a:e], r[1, a:e], r[2, a:e], work.terms[a:e])
    return sum_all(lo, hi, front, work.terms, work.sums[2], team)


@unit
def solve_stage(g, team, substep, substeps, step):
    """Solve a stage by Newton's method from the positions at hand; counts it if that does not converge.

    Where linear systems are solved closely, the second step has the matrix of the first: as a rule the first has
    solved the stage, and the beginning of the second shows that it has.
    """
    problem, b, lo, hi = g.problem, g.share * step, team.lo, team.hi
    system = problem.system
    s, work, counts, settings = system.state, system.work, system.counts, system.settings
    tolerance = tolerance_of(settings, b)
    again = False
    run(problem.evaluate, team, substep, 1, b)
    for iteration in range(settings.iterations):
        if again:
            run(problem.again, team, substep, 1, b)
        else:
            run(problem.aim, team, iteration, 1, b)
        # A step is taken in any case: what all stages left of slow motion would add up.
        if iteration > 0 and system.found[FIRST] < 1.0:
            return
        slope = system.found[SLOPE]
        counts[NEWTON] += 1
        copy(s.x[lo:hi], work.old[0, lo:hi])
        copy(s.y[lo:hi], work.old[1, lo:hi])
        copy(s.z[lo:hi], work.old[2, lo:hi])
        share, here = 1.0, 0.0
        for attempt in range(TRIES):
            if attempt > 0:
                share *= min(max(slope / (slope - here), NARROWEST), WIDEST)
                counts[SHORTENED] += 1
            step_along(lo, hi, share, system)
            run(problem.evaluate, team, substep, 1, b)
            here = slope_here(lo, hi, system, team)
            if here >= -BACK * slope:
                break
        if settings.closely:
            again = iteration == 0 and share == 1.0
        else:
            left = share * largest_correction(lo, hi, system, tolerance, problem.pressing, b)
            if largest_of_all(lo, hi, left, work.largest, team) < 1.0:
                return
    counts[UNSOLVED] += 1


@routine
def largest_correction(lo, hi, system, tolerance, f, b):
    """Largest of the Newton steps of the vertices lo to hi, as a share of what may be left.

    That is the `tolerance` [m], or what positions are rounded by if that is more, and where contact
    presses, with forces `f` (3, N) or of no vertices at all, at most what changes a velocity by little as against
    `SLIP`, on which friction depends; the linear systems are not solved much better for such a vertex than its pressure
    is.
    """
    s, d, front = system.state, system.matrix.vectors[0], system.matrix.front
    digits = system.settings.digits
    largest = longest_share(d, front + lo, tolerance, digits, s.x[lo:hi], s.y[lo:hi], s.z[lo:hi])
    least = min(tolerance, EXACT * SLIP * b)
    if f.shape[1] > 0:
        for i in range(lo, hi):
            if f[0, i] != 0.0 or f[1, i] != 0.0 or f[2, i] != 0.0:
                largest = max(largest, longest(d, front + i, front + i + 1) / least)
    return largest


@unit
def place_bones(g, team, substep, substeps, step):
    """Place the bones at a time within the step."""
    place_at((substep + g.at) * step, g.motion, g.bones)


@unit
def place_attached(g, team, substep, substeps, step):
    """Place what the bones hold, with the velocity of its place."""
    time, b = (substep + g.at) * step, g.share * step
    hold_rigidly(team.lo, team.hi, g.state, g.attached, g.bones, time, b, g.target)


@unit
def aim_backward(g, team, substep, substeps, step):
    """Begin a step of backward Euler."""
    s, target, lo, hi = g.state, g.work.target, team.lo, team.hi
    begin_euler(
        s.x.dtype.type(step), s.x[lo:hi], s.y[lo:hi], s.z[lo:hi], s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi],
        target[:, lo:hi],
    )  # fmt: skip


@unit
def aim_trapezoid(g, team, substep, substeps, step):
    """Begin the first stage of TR-BDF2."""
    s, work, lo, hi, b = g.state, g.work, team.lo, team.hi, 0.5 * GAMMA * step
    ahead = 2.0 * b * b if g.settings.closely else 0.0
    begin_trapezoid(
        s.x.dtype.type(b), s.x.dtype.type(ahead), work.acceleration[:, lo:hi], s.x[lo:hi], s.y[lo:hi], s.z[lo:hi],
        s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi], work.start[:, lo:hi], work.target[:, lo:hi],
    )  # fmt: skip


@unit
def aim_bdf2(g, team, substep, substeps, step):
    """Begin the second stage of TR-BDF2."""
    s, work, lo, hi = g.state, g.work, team.lo, team.hi
    dtype, c1, rest = s.x.dtype.type, 1.0 / (GAMMA * (2.0 - GAMMA)), (1.0 - GAMMA) * step
    ahead = rest * rest / (GAMMA * step) if g.settings.closely else 0.0
    begin_bdf2(
        dtype(c1 - 1.0), dtype(c1), dtype(rest), dtype(ahead), s.x[lo:hi], s.y[lo:hi], s.z[lo:hi],
        s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi], work.start[:, lo:hi], work.target[:, lo:hi],
    )  # fmt: skip
