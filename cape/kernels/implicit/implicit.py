"""Implicit steps: backward Euler and TR-BDF2, one call is one frame, for one thread or each of a team.

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

from cape.kernels.cloth.forces import compute_forces
from cape.kernels.contact.penalty import SLIP, look_around, press_all
from cape.kernels.contact.shapes import forget_places
from cape.kernels.implicit.conjugate_gradients import CHUNK, dot_terms, solve_linear, sum_all
from cape.kernels.implicit.stages import (
    begin_bdf2,
    begin_euler,
    begin_trapezoid,
    follow,
    longest,
    move,
    note_acceleration,
    place_at,
    scale,
    stand,
    subtract_inertia,
)
from cape.kernels.implicit.stiffness import add, copy, prepare
from cape.kernels.jit import driver
from cape.kernels.self_contact.self_contact import add_held, add_pressure, keep_apart
from cape.kernels.solve.attachments import hold_rigidly
from cape.kernels.solve.frame import begin_frame, keep_out
from cape.kernels.solve.journal import note_end, note_integrated, note_pressed
from cape.kernels.team import meet, span

GAMMA = 2.0 - math.sqrt(2.0)
SLOPE = 0.9  # share of the first directional derivative up to which a step may overshoot
TRIES = 6  # of the line search
NARROWEST, WIDEST = 0.1, 0.9  # share of the step at hand that the next try takes
GUARD = 0.5  # share of the thickness that a step's end leaves free where contact forces did not
EXACT = 0.1  # share of SLIP to which velocities are solved where contact presses: less costs iterations
UNSOLVED, NEWTON, LINEAR, SHORTENED = 0, 1, 2, 3  # what is counted: stages not solved, iterations, shortened steps


@driver
def evaluate(lo, hi, problem, substep, penalty, b, team):
    """Set velocities, contact forces and the residual that belong to the positions of the vertices lo to hi."""
    s, work, inertia = problem.state, problem.work, problem.inertia
    dtype = s.x.dtype.type
    rate, g = dtype(1.0 / b), inertia.gravity
    t, f, r = work.target, work.forces, work.vectors[1]
    a, e = problem.matrix.front + lo, problem.matrix.front + hi
    follow(
        rate, t[0, lo:hi], t[1, lo:hi], t[2, lo:hi], s.x[lo:hi], s.y[lo:hi], s.z[lo:hi],
        s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi],
    )  # fmt: skip
    meet(team)
    compute_forces(lo, hi, s, problem.model, f[0], f[1], f[2], problem.scratch, team)
    press_all(lo, hi, problem, problem.contacts.groups, substep, b, penalty)
    add_contact(lo, hi, penalty, f)
    add_pressure(lo, hi, problem.contacts.pressure, inertia.mass, f)
    subtract_inertia(
        rate, dtype(g[0]), dtype(g[1]), dtype(g[2]), inertia.free[lo:hi], inertia.mass[lo:hi],
        t[3, lo:hi], t[4, lo:hi], t[5, lo:hi], s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi],
        f[0, lo:hi], f[1, lo:hi], f[2, lo:hi], r[0, a:e], r[1, a:e], r[2, a:e],
    )  # fmt: skip


@driver
def add_contact(lo, hi, penalty, f):
    """Add the contact forces of the vertices lo to hi to the others."""
    if penalty is not None:
        for axis in range(3):
            add(penalty.force[axis, lo:hi], f[axis, lo:hi])


@driver
def step_along(lo, hi, share, problem):
    """Move the vertices lo to hi a share of the Newton step from where it began."""
    s, o, d = problem.state, problem.work.old, problem.work.vectors[0]
    a, e = problem.matrix.front + lo, problem.matrix.front + hi
    move(
        s.x.dtype.type(share), o[0, lo:hi], o[1, lo:hi], o[2, lo:hi], d[0, a:e], d[1, a:e], d[2, a:e],
        s.x[lo:hi], s.y[lo:hi], s.z[lo:hi],
    )  # fmt: skip


@driver
def slope_here(lo, hi, front, work, team):
    """Minus the directional derivative along the Newton step at the current residual [J]."""
    d, r, a, e = work.vectors[0], work.vectors[1], front + lo, front + hi
    dot_terms(d[0, a:e], d[1, a:e], d[2, a:e], r[0, a:e], r[1, a:e], r[2, a:e], work.terms[a:e])
    return sum_all(lo, hi, front, work.terms, work.sums[2], team)


@driver
def solve_newton_step(lo, hi, problem, penalty, b, forcing, team):
    """Linearise at the state and solve for the step; returns minus the directional derivative along it [J]."""
    work, matrix = problem.work, problem.matrix
    prepare(lo, hi, problem.state, problem.model, b, matrix, penalty, work.inverse, team)
    iterations, slope = solve_linear(
        lo, hi, problem.model, matrix, b, work.scratch, work.inverse, work.vectors, work.terms, work.sums,
        forcing, problem.settings.linear_iterations, team,
    )  # fmt: skip
    problem.counts[LINEAR] += iterations
    return slope


@driver
def solve_stage(lo, hi, problem, substep, b, team):
    """Solve a stage by Newton's method from the positions at hand; counts it if that does not converge."""
    s, work, front, penalty = problem.state, problem.work, problem.matrix.front, problem.penalty
    # What is left to correct acts on a vertex like a force, of its mass times that over b squared.
    shorter = min(1.0, b / problem.settings.usual)
    tolerance = problem.settings.tolerance * shorter * shorter
    evaluate(lo, hi, problem, substep, penalty, b, team)
    for _ in range(problem.settings.iterations):
        slope = solve_newton_step(lo, hi, problem, penalty, b, problem.settings.forcing, team)
        problem.counts[NEWTON] += 1
        copy(s.x[lo:hi], work.old[0, lo:hi])
        copy(s.y[lo:hi], work.old[1, lo:hi])
        copy(s.z[lo:hi], work.old[2, lo:hi])
        share, here = 1.0, 0.0
        for attempt in range(TRIES):
            if attempt > 0:
                share *= min(max(slope / (slope - here), NARROWEST), WIDEST)
                problem.counts[SHORTENED] += 1
            step_along(lo, hi, share, problem)
            evaluate(lo, hi, problem, substep, penalty, b, team)
            here = slope_here(lo, hi, front, work, team)
            if here >= -SLOPE * slope:
                break
        left = share * largest_correction(lo, hi, front, work, tolerance, penalty, b)
        if largest_of_all(lo, hi, left, work, team) < 1.0:
            return
    problem.counts[UNSOLVED] += 1


@driver
def largest_correction(lo, hi, front, work, tolerance, penalty, b):
    """Largest of the Newton steps of the vertices lo to hi, as a share of what may be left.

    That is the `tolerance` [m], and where contact presses at most what changes a velocity by little as against `SLIP`,
    on which friction depends; the linear systems are not solved much better for such a vertex than its pressure is.
    """
    d = work.vectors[0]
    largest = longest(d, front + lo, front + hi) / tolerance
    if penalty is not None:
        f, least = penalty.force, min(tolerance, EXACT * SLIP * b)
        for i in range(lo, hi):
            if f[0, i] != 0.0 or f[1, i] != 0.0 or f[2, i] != 0.0:
                largest = max(largest, longest(d, front + i, front + i + 1) / least)
    return largest


@driver
def largest_of_all(lo, hi, value, work, team):
    """Largest of the values that the threads have; a NaN is larger than all."""
    largest = work.largest
    largest[lo // CHUNK : (hi + CHUNK - 1) // CHUNK] = value
    meet(team)
    result = 0.0
    for chunk in range(largest.size):
        if math.isnan(largest[chunk]):
            return math.nan
        result = max(result, largest[chunk])
    return result


@driver
def accelerate(lo, hi, problem, b, team):
    """Find the accelerations at the start of a frame from A a = (f + M g) / b^2.

    Those of modes slower than the step are what f and M say, to second order in the step. The others, which that would
    make huge from the last digits of the positions, are bounded.
    """
    s, work = problem.state, problem.work
    dtype = s.x.dtype.type
    stand(
        dtype(b), s.x[lo:hi], s.y[lo:hi], s.z[lo:hi], s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi], work.target[:, lo:hi]
    )  # fmt: skip
    evaluate(lo, hi, problem, 0, None, b, team)
    solve_newton_step(lo, hi, problem, None, b, problem.settings.forcing**3, team)
    d, a, e = work.vectors[0], problem.matrix.front + lo, problem.matrix.front + hi
    scale(dtype(1.0 / (b * b)), d[0, a:e], d[1, a:e], d[2, a:e], work.acceleration[:, lo:hi])


@driver
def keep_acceleration(lo, hi, problem, b):
    """Note the accelerations at the end of a step, without those of contact."""
    s, work = problem.state, problem.work
    note_acceleration(
        s.x.dtype.type(1.0 / b), s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi], work.target[:, lo:hi],
        work.acceleration[:, lo:hi],
    )  # fmt: skip
    _without_contact(lo, hi, problem.inertia.inverse_mass, work.acceleration, problem.penalty)


@driver
def _without_contact(lo, hi, inverse_mass, acceleration, penalty):
    if penalty is not None:
        for axis in range(3):
            for i in range(lo, hi):
                acceleration[axis, i] -= inverse_mass[i] * penalty.force[axis, i]


@driver
def balance(lo, hi, inverse_mass, acceleration, penalty):
    """Add the share of each vertex's contact force that brings its acceleration closest to zero, at most all of it.

    A vertex at rest keeps the force that it needs; one that has just been stopped is not thrown back.
    """
    if penalty is not None:
        a, f = acceleration, penalty.force
        for i in range(lo, hi):
            w = inverse_mass[i]
            squared = w * (f[0, i] * f[0, i] + f[1, i] * f[1, i] + f[2, i] * f[2, i])
            if squared > 0.0:
                share = -(a[0, i] * f[0, i] + a[1, i] * f[1, i] + a[2, i] * f[2, i]) / squared
                share = w * min(max(share, 0.0), 1.0)
                for axis in range(3):
                    a[axis, i] += share * f[axis, i]


@driver
def begin(lo, hi, problem, duration, h, team):
    """Find the velocities at which the bones move through the frame, and what the cloth may touch in its first step."""
    contacts, bones, s = problem.contacts, problem.bones, problem.state
    begin_frame(
        lo, hi, s, problem.attached, contacts.groups, contacts.faces, problem.motion, bones, duration, 1, team
    )  # fmt: skip
    look_around(lo, hi, contacts.groups, bones, s, h)


@driver
def place_bones(lo, hi, problem, time, b):
    """Place the bones and what they hold of the vertices lo to hi `time` [s] after the frame's start."""
    place_at(time, problem.motion, problem.bones)
    forget_places(problem.contacts.groups)
    hold_rigidly(lo, hi, problem.state, problem.attached, problem.bones, time, b, problem.work.target)


@driver
def leave_colliders(lo, hi, problem, earlier, substep, substeps, h, journal, team):
    """Move out what a step of `h` [s] leaves deeper than contact forces should, or on a fast limb's other side.

    And keep the cloth's layers apart.
    """
    contacts, s, inverse_mass = problem.contacts, problem.state, problem.inertia.inverse_mass
    note_integrated(lo, hi, s, journal, substep)
    note_pressed(lo, hi, problem.penalty, contacts.pressure, journal, substep)
    keep_out(
        lo, hi, s, inverse_mass, earlier, contacts.free, contacts.groups, contacts.faces, problem.bones, GUARD, substep,
        h, team,
    )  # fmt: skip
    keep_apart(s, contacts.layers, inverse_mass, substep, substeps - 1 - substep, h, team)
    note_end(lo, hi, s, journal, substep)


@driver
def backward_euler_frame(problem, substeps, duration, journal, team):
    """Advance the state by `duration` [s] in `substeps` steps of backward Euler.

    Of the `problem`, `scratch`, `work.scratch`, `counts`, `bones` and `contacts` are this thread's own. `journal` is
    None where nothing is noted.
    """
    s, work = problem.state, problem.work
    lo, hi = span(s.x.size, team)
    h = duration / substeps
    begin(lo, hi, problem, duration, h, team)
    for substep in range(substeps):
        place_bones(lo, hi, problem, substep * h, h)
        begin_euler(
            s.x.dtype.type(h), s.x[lo:hi], s.y[lo:hi], s.z[lo:hi], s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi],
            work.target[:, lo:hi],
        )  # fmt: skip
        place_bones(lo, hi, problem, (substep + 1) * h, h)
        solve_stage(lo, hi, problem, substep, h, team)
        leave_colliders(lo, hi, problem, None, substep, substeps, h, journal, team)


@driver
def tr_bdf2_frame(problem, substeps, duration, journal, team):
    """Advance the state by `duration` [s] in `substeps` steps of TR-BDF2; arguments as for backward Euler."""
    s, work = problem.state, problem.work
    lo, hi = span(s.x.size, team)
    h = duration / substeps
    b, dtype = 0.5 * GAMMA * h, s.x.dtype.type
    c1 = 1.0 / (GAMMA * (2.0 - GAMMA))
    begin(lo, hi, problem, duration, h, team)
    for substep in range(substeps):
        place_bones(lo, hi, problem, substep * h, b)
        if substep == 0:
            accelerate(lo, hi, problem, b, team)
            press_all(lo, hi, problem, problem.contacts.groups, substep, b, problem.penalty)
            balance(lo, hi, problem.inertia.inverse_mass, work.acceleration, problem.penalty)
        begin_trapezoid(
            dtype(b), work.acceleration[:, lo:hi], s.x[lo:hi], s.y[lo:hi], s.z[lo:hi],
            s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi], work.start[:, lo:hi], work.target[:, lo:hi],
        )  # fmt: skip
        place_bones(lo, hi, problem, (substep + GAMMA) * h, b)
        solve_stage(lo, hi, problem, substep, b, team)
        begin_bdf2(
            dtype(c1 - 1.0), dtype(c1), dtype((1.0 - GAMMA) * h), s.x[lo:hi], s.y[lo:hi], s.z[lo:hi],
            s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi], work.start[:, lo:hi], work.target[:, lo:hi],
        )  # fmt: skip
        place_bones(lo, hi, problem, (substep + 1) * h, b)
        solve_stage(lo, hi, problem, substep, b, team)
        keep_acceleration(lo, hi, problem, b)
        add_held(lo, hi, -1.0, problem.contacts.pressure, work.acceleration)
        leave_colliders(lo, hi, problem, work.start, substep, substeps, h, journal, team)
        add_held(lo, hi, 1.0, problem.contacts.pressure, work.acceleration)
        balance(lo, hi, problem.inertia.inverse_mass, work.acceleration, problem.penalty)
