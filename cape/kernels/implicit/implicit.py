"""Implicit steps: backward Euler and TR-BDF2.

Every stage finds positions x with v = (x - xt) / b and M (v - vt) / b = f(x, v) + M g:

    backward Euler   b = h,  xt = x0,  vt = v0
    TR-BDF2          b = gamma h / 2,  gamma = 2 - 2^1/2, for both stages
      to t + gamma h   xt = x0 + b v0,  vt = v0 + b a0        trapezoidal rule, a0 the acceleration at the start
      to t + h         xt = c1 x1 - c0 x0,  vt = c1 v1 - c0 v0,  c1 = 1 / (gamma (2 - gamma)),  c0 = c1 - 1

Bank et al. 1985, "Transient simulation of silicon devices and circuits"; Hosea and Shampine 1996, "Analysis and
implementation of TR-BDF2". As they advise, a0 is that of the stage before, (v - vt) / b, which needs no digits of a
stiff spring's length. Contact enters it as far as it holds back other forces: the force of an impact is large and gone
a moment later.

Newton's method with a line search on the directional derivative alone, since neither damping, air nor friction has an
energy: a step is taken unless the derivative changes sign and is nearly as large as before (the curvature condition of
Nocedal and Wright 2006, eq. 3.7b); otherwise the secant leads towards its zero.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.bones import Motion, MotionRoom
from cape.kernels.contact.penalty import SLIP, Penalty
from cape.kernels.implicit.conjugate_gradients import CHUNK, dot_terms, solve_linear, sum_all
from cape.kernels.implicit.stages import (
    begin_bdf2,
    begin_euler,
    begin_trapezoid,
    follow,
    longest,
    longest_share,
    move,
    note_acceleration,
    place_at,
    scale,
    stand,
    subtract_inertia,
)
from cape.kernels.implicit.stiffness import Matrix, copy
from cape.kernels.jit import routine, unit
from cape.kernels.program import Program, run
from cape.kernels.solve.attachments import Attached, hold_rigidly
from cape.kernels.state import Inertia, State
from cape.kernels.team import meet

Array = NDArray[np.floating]

GAMMA = 2.0 - math.sqrt(2.0)
SLOPE = 0.9  # share of the first directional derivative up to which a step may overshoot
TRIES = 6  # of the line search
NARROWEST, WIDEST = 0.1, 0.9  # share of the step at hand that the next try takes
GUARD = 0.5  # share of the thickness that a step's end leaves free where contact forces did not
EXACT = 0.1  # share of SLIP to which velocities are solved where contact presses: less costs iterations
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

    In shorter ones it shrinks as their `power`, and the forcing as its own. Where `foreseen`, the tolerance is for what
    a Newton step leaves, not for the step. `digits` is the share of a coordinate below which steps are rounding.
    """

    tolerance: float
    power: int
    foreseen: bool
    usual: float
    digits: float
    iterations: int
    forcing: float
    forcing_power: int
    linear_iterations: int


class System(NamedTuple):
    """The equations of a stage.

    Three programs make them up: `residual` sets all forces but inertia, `linearise` the matrix at a state, `product` is
    the matrix times a vector. `counts` (4,) and `slope` (1,), minus the directional derivative along a Newton step [J],
    are a thread's own.
    """

    state: State
    inertia: Inertia
    matrix: Matrix
    work: Work
    settings: Settings
    counts: NDArray[np.int64]
    slope: NDArray[np.float64]
    residual: Program
    linearise: Program
    product: Program


class Problem(NamedTuple):
    """A system and the programs that solve it: `evaluate` finds its residual, `aim` a Newton step.

    `pressing` (3, N) are the forces of contact [N], of no vertices where nothing presses.
    """

    system: System
    evaluate: Program
    aim: Program
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


class Balance(NamedTuple):
    """Accelerations (3, N) [m/s2], of which the forces of contact hold some back; `contact` finds those."""

    acceleration: Array
    inverse_mass: Array
    penalty: Penalty
    contact: Program
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
    """Linearise at the state and solve for a Newton step."""
    run(g.linearise, team, 0, 1, b)
    forcing = g.settings.forcing * min(1.0, b / g.settings.usual) ** g.settings.forcing_power
    iterations, slope = solve_linear(g, b, forcing, team)
    g.counts[LINEAR] += iterations
    g.slope[0] = slope


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
    """Solve a stage by Newton's method from the positions at hand; counts it if that does not converge."""
    problem, b, lo, hi = g.problem, g.share * step, team.lo, team.hi
    system = problem.system
    s, work, counts = system.state, system.work, system.counts
    tolerance = system.settings.tolerance * min(1.0, b / system.settings.usual) ** system.settings.power
    before = 0.0
    run(problem.evaluate, team, substep, 1, b)
    for _ in range(system.settings.iterations):
        run(problem.aim, team, substep, 1, b)
        slope = system.slope[0]
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
            if here >= -SLOPE * slope:
                break
        ahead = share_ahead(slope, before) if system.settings.foreseen and share == 1.0 else 1.0
        left = share * largest_correction(lo, hi, system, tolerance, ahead, problem.pressing, b)
        if largest_of_all(lo, hi, left, work.largest, team) < 1.0:
            return
        before = slope
    counts[UNSOLVED] += 1


@routine
def share_ahead(slope, before):
    """What Newton steps to come will add up to, as a share of the last one, at most 1.

    Steps that shrink by the factor theta each add up to theta / (1 - theta) of it (Hairer and Wanner 1996, "Solving
    Ordinary Differential Equations II", eq. IV.8.10). Their lengths are taken in the norm of A, whose square along a
    step d with A d = r is the `slope` r . d; `before` is that of the step before, 0 if there was none.
    """
    if not 0.0 < slope < 0.25 * before:
        return 1.0
    theta = math.sqrt(slope / before)
    return theta / (1.0 - theta)


@routine
def largest_correction(lo, hi, system, tolerance, ahead, f, b):
    """Largest of the Newton steps of the vertices lo to hi, as a share of what may be left.

    That is the `tolerance` [m] over `ahead`, or what positions are rounded by if that is more, and where contact
    presses, with forces `f` (3, N) or of no vertices at all, at most what changes a velocity by little as against
    `SLIP`, on which friction depends; the linear systems are not solved much better for such a vertex than its pressure
    is.
    """
    s, d, front = system.state, system.matrix.vectors[0], system.matrix.front
    digits = system.settings.digits
    largest = longest_share(d, front + lo, tolerance / ahead, digits, s.x[lo:hi], s.y[lo:hi], s.z[lo:hi])
    least = min(tolerance, EXACT * SLIP * b)
    if f.shape[1] > 0:
        for i in range(lo, hi):
            if f[0, i] != 0.0 or f[1, i] != 0.0 or f[2, i] != 0.0:
                largest = max(largest, longest(d, front + i, front + i + 1) / least)
    return largest


@routine
def largest_of_all(lo, hi, value, largest, team):
    """Largest of the values that the threads have; a NaN is larger than all."""
    largest[lo // CHUNK : (hi + CHUNK - 1) // CHUNK] = value
    meet(team)
    result = 0.0
    for chunk in range(largest.size):
        if math.isnan(largest[chunk]):
            return math.nan
        result = max(result, largest[chunk])
    return result


@unit
def find_acceleration(g, team, substep, substeps, step):
    """Find the accelerations at the start of a frame from A a = (f + M g) / b^2, without contact.

    Those of modes slower than the step are what f and M say, to second order in the step. The others, which that would
    make huge from the last digits of the positions, are bounded.
    """
    if substep == 0:
        problem, b, lo, hi = g.problem, g.share * step, team.lo, team.hi
        system = problem.system
        s, work = system.state, system.work
        dtype = s.x.dtype.type
        stand(
            dtype(b), s.x[lo:hi], s.y[lo:hi], s.z[lo:hi], s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi], work.target[:, lo:hi]
        )  # fmt: skip
        run(problem.evaluate, team, 0, 1, b)
        run(problem.aim, team, 0, 1, b)
        d, a, e = system.matrix.vectors[0], system.matrix.front + lo, system.matrix.front + hi
        scale(dtype(1.0 / (b * b)), d[0, a:e], d[1, a:e], d[2, a:e], work.acceleration[:, lo:hi])


@unit
def hold_back_at_start(g, team, substep, substeps, step):
    """Find the contact forces at the start of a frame, and what they hold back of the accelerations there."""
    if substep == 0:
        run(g.contact, team, substep, 1, g.share * step)
        balance(g, team.lo, team.hi)


@unit
def hold_back(g, team, substep, substeps, step):
    """Let contact forces hold back accelerations, as far as they act."""
    balance(g, team.lo, team.hi)


@routine
def balance(g, lo, hi):
    """Add the share of each vertex's contact force that brings its acceleration closest to zero, at most all of it.

    A vertex at rest keeps the force that it needs; one that has just been stopped is not thrown back.
    """
    a, f = g.acceleration, g.penalty.force
    for i in range(lo, hi):
        w = g.inverse_mass[i]
        squared = w * (f[0, i] * f[0, i] + f[1, i] * f[1, i] + f[2, i] * f[2, i])
        if squared > 0.0:
            share = -(a[0, i] * f[0, i] + a[1, i] * f[1, i] + a[2, i] * f[2, i]) / squared
            share = w * min(max(share, 0.0), 1.0)
            for axis in range(3):
                a[axis, i] += share * f[axis, i]


@unit
def keep_acceleration(g, team, substep, substeps, step):
    """Note the accelerations at the end of a step."""
    system, b, lo, hi = g.problem.system, g.share * step, team.lo, team.hi
    s, work = system.state, system.work
    note_acceleration(
        s.x.dtype.type(1.0 / b), s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi], work.target[:, lo:hi],
        work.acceleration[:, lo:hi],
    )  # fmt: skip


@unit
def leave_out_contact(g, team, substep, substeps, step):
    """Take the forces of contact out of accelerations."""
    for axis in range(3):
        for i in range(team.lo, team.hi):
            g.acceleration[axis, i] -= g.inverse_mass[i] * g.penalty.force[axis, i]


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
    s, work, lo, hi = g.state, g.work, team.lo, team.hi
    begin_trapezoid(
        s.x.dtype.type(0.5 * GAMMA * step), work.acceleration[:, lo:hi], s.x[lo:hi], s.y[lo:hi], s.z[lo:hi],
        s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi], work.start[:, lo:hi], work.target[:, lo:hi],
    )  # fmt: skip


@unit
def aim_bdf2(g, team, substep, substeps, step):
    """Begin the second stage of TR-BDF2."""
    s, work, lo, hi = g.state, g.work, team.lo, team.hi
    dtype, c1 = s.x.dtype.type, 1.0 / (GAMMA * (2.0 - GAMMA))
    begin_bdf2(
        dtype(c1 - 1.0), dtype(c1), dtype((1.0 - GAMMA) * step), s.x[lo:hi], s.y[lo:hi], s.z[lo:hi],
        s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi], work.start[:, lo:hi], work.target[:, lo:hi],
    )  # fmt: skip
