"""Contact of a cloth with itself: vertices with triangles, and edges with edges, at the cloth's thickness.

Bridson, Fedkiw and Anderson 2002, "Robust treatment of collisions, contact and friction for cloth animation", find
what passed through what within a step from the roots of cubics and undo it, at last as rigid zones: made for steps of
several milliseconds, it costs most where steps are many. Chen, Hsu, Liu, Macklin, Yang and Yuksel 2025, "Offset
geometric contact", bound how far each vertex may go, so that nothing ever passes: that needs a solver which bears
with clipped steps, as an explicit one does not. Here the normal leads along the line between the closest points, of
whatever features, as in the latter, so that it turns smoothly from a triangle's inside over its edges; what passed
through is known because each pair remembers its side; and the answer is an inelastic impulse with friction, as in the
former. That suits steps of a tenth of a millisecond, in which layers that close at 30 m/s come nearer by less than
their thickness; in the longer steps of implicit solvers the remembered side still brings back what went through.

Three things keep it cheap, and at rest:

- A pair is looked at again when its points, at the speed they have, could meet (conservative advancement, Mirtich 1996,
  "Impulse-based dynamic simulation of rigid body systems", section 2.3).
- Touching pairs are looked at together, at beats: as seldom as what presses them lets them sink in by no more than a
  small slack.
- What the impulses of a beat had to do is done by forces until the next beat, which then corrects them: warm starting
  (Catto 2005, "Iterative dynamics with temporal coherence"). Layers at rest need no impulses, and don't tremble.

Pairs that are too close move apart slowly, without any velocity, but for those that pass: a start with layers inside
each other is not torn. One thread does all of it, in the order of the lists, so that results repeat to the last bit.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.contact.watch import JOLT, alarm_all
from cape.kernels.jit import inlined, kernel, unit
from cape.kernels.program import Program, run
from cape.kernels.self_contact.closest import from_edge, from_triangle, speed_to_edge, speed_to_triangle
from cape.kernels.self_contact.near_pairs import TOUCHING, Pairs, search
from cape.kernels.self_contact.patches import FloatArray, Indices, Patches, Sight, is_foreseen, look
from cape.kernels.self_contact.recovery import moved_apart
from cape.kernels.state import State

# s; beats, and looks for new pairs, are at most sqrt(LONGEST * step) apart, so that what they leave open vanishes with
# the step while they cost less and less of it: 5 substeps of 0.2 ms, 1 of 5 ms.
LONGEST = 5e-3
CALM = 3e-3  # s; so far apart are beats at most, and looks at pairs that aren't due yet, where steps are short
# s that vertices are foreseen to go on at most; longer ones need fewer searches, which list more. They are foreseen for
# no longer than a look more than the last list served: where cloth whips about none does for long, whatever it lists.
HORIZON = 6e-3
ACCELERATION = 20.0  # m/s2 that two points may have towards each other before their pair is looked at again
SLACK = 0.02  # of the thickness, by which touching layers may sink in or be apart
SLIDE = 0.2  # of the thickness, by which close edges may slide before it is seen whether they cross
# Of what a beat finds to be done, the share by which the forces that go on until the next change. Stiff springs vibrate
# several times between two beats: more of what a beat happens to see of that feeds it.
LEARNED = 0.2
# A vertex is thrown by at most so many times the speed that it is to stop: close to attached ones, which nothing stops,
# those that are free would be thrown far. Where all are free and as heavy, it is 1 at most.
MOST_LEVERAGE = 2.0
GRAZE = 1e-5  # m; points that are closer tell nothing about their sides
NOW, DUE, BEAT, SINCE, PRESSED, SEARCHES, SOUGHT, AHEAD, CLOCKS = range(9)


class Pressure(NamedTuple):
    """What acts between layers until the next beat.

    `held` (3, N) [m/s2] is what forces between touching pairs do to the vertices. `clock` (CLOCKS,), times in seconds:
    now, when the next pair is due, when the next beat is, how long ago the last was; whether anything is held, how many
    searches there were, when the last was, and how far ahead it looked.
    """

    held: FloatArray
    clock: FloatArray


class Layers(NamedTuple):
    """What keeps a cloth's layers at a distance of `thickness` [m], with Coulomb `friction`.

    Pairs that come within `thickness + margin` are watched. `alarm` and `spreads` are those of the colliders' `Shapes`.
    """

    thickness: float
    margin: float
    friction: float
    patches: Patches
    sight: Sight
    faces: Pairs
    edges: Pairs
    pressure: Pressure
    alarm: Indices
    spreads: FloatArray


class Pressed(NamedTuple):
    """A cloth, and what acts between its layers."""

    state: State
    pressure: Pressure


class PressedForces(NamedTuple):
    """What acts between layers, `mass` [kg] (N,) and `forces` (3, N) [N] to add it to."""

    pressure: Pressure
    mass: NDArray[np.floating]
    forces: NDArray[np.floating]


class PressedAcceleration(NamedTuple):
    """What acts between layers, and accelerations (3, N) [m/s2] to add a `share` of it to."""

    pressure: Pressure
    acceleration: NDArray[np.floating]
    share: float


class Layered(NamedTuple):
    """A cloth whose layers are kept apart; `inverse_mass` [1/kg] (N,) is zero for attached vertices.

    `search` lists the pairs that may touch soon: `Ahead`, then `Searched`, in a program.
    """

    state: State
    layers: Layers
    inverse_mass: NDArray[np.floating]
    search: Program


class Ahead(NamedTuple):
    """A cloth that is looked at, where that is noted, `Sight.places`, and the `clock` of its `Pressure`."""

    state: State
    places: FloatArray
    clock: FloatArray


class Searched(NamedTuple):
    """A cloth, as it was looked at, in which pairs that may touch soon are searched for; `inverse_mass` as above."""

    layers: Layers
    inverse_mass: NDArray[np.float64]


@unit
def look_ahead(g, team, substep, substeps, step):
    """Note where vertices are and how they go on until the next search."""
    least = looks_between(step) * step
    look(g.state, least, max(g.clock[AHEAD], least), g.places)


@unit
def search_pairs(g, team, substep, substeps, step):
    """List the pairs that may touch before the next search.

    It is the same code whatever the precision of the cloth's state.
    """
    search(g.layers, g.inverse_mass)


@inlined
def looks_between(step):
    """Substeps from one look for new pairs to the next."""
    return max(1, round(math.sqrt(LONGEST / step)))


@unit
def press(g, team, substep, substeps, step):
    """Let the forces between touching layers act for a substep.

    Call it between integration and the colliders, which take up what one layer presses onto them through another.
    """
    s, held, lo, hi = g.state, g.pressure.held, team.lo, team.hi
    if g.pressure.clock[PRESSED] > 0.0:
        accelerate(
            s.x[lo:hi], s.y[lo:hi], s.z[lo:hi], s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi],
            held[0, lo:hi], held[1, lo:hi], held[2, lo:hi], s.x.dtype.type(step),
        )  # fmt: skip


@kernel
def accelerate(x, y, z, vx, vy, vz, ax, ay, az, step):
    """Add accelerations to a step: v += step a, x += step^2 a."""
    for i in range(x.size):
        dx, dy, dz = step * ax[i], step * ay[i], step * az[i]
        vx[i] += dx
        vy[i] += dy
        vz[i] += dz
        x[i] += step * dx
        y[i] += step * dy
        z[i] += step * dz


@unit
def add_pressure(g, team, substep, substeps, step):
    """Add the forces between touching layers to those on vertices, for steps that are solved for."""
    held = g.pressure.held
    if g.pressure.clock[PRESSED] > 0.0:
        for axis in range(3):
            for i in range(team.lo, team.hi):
                g.forces[axis, i] += g.mass[i] * held[axis, i]


@unit
def add_held(g, team, substep, substeps, step):
    """Add a share of what the forces between touching layers do to accelerations."""
    held = g.pressure.held
    for axis in range(3):
        for i in range(team.lo, team.hi):
            g.acceleration[axis, i] += g.share * held[axis, i]


@unit
def keep_apart(g, team, substep, substeps, step):
    """Keep the layers of a cloth apart; one thread does it for all.

    Nothing is done once a list of pairs was too short: the frame is to be done again, with longer ones.
    """
    s, layers, inverse_mass = g.state, g.layers, g.inverse_mass
    remaining = substeps - 1 - substep
    if layers.faces.counts[1] + layers.edges.counts[1] == 0:
        clock, faces, edges, patches = layers.pressure.clock, layers.faces, layers.edges, layers.patches
        held = layers.pressure.held
        every = looks_between(step)
        clock[NOW] += step
        clock[SINCE] += step
        # A frame ends with a beat, so that what its caller sees are no velocities that are about to be stopped.
        beat = remaining == 0 or clock[NOW] + 0.5 * step >= clock[BEAT]
        if beat:
            held[:] = 0.0
            clock[PRESSED] = faces.counts[0] + edges.counts[0]
        if beat or clock[NOW] + step > clock[DUE]:
            interval = clock[SINCE] if beat else step
            # Also what is due soon, so that going through the lists pays.
            until = clock[NOW] + max(every * step, CALM)
            due, hardest = part_vertices(
                faces.counts[0], faces.first, faces.second, faces.apart, faces.due, faces.force, patches.triangles,
                layers.thickness, layers.friction, step, interval, clock[NOW], until, beat, inverse_mass,
                s.x, s.y, s.z, s.vx, s.vy, s.vz, held,
            )  # fmt: skip
            due_edges, hardest_edges = part_edges(
                edges.counts[0], edges.first, edges.second, edges.apart, edges.due, edges.force, patches.edges,
                layers.thickness, layers.friction, step, interval, clock[NOW], until, beat, inverse_mass,
                s.x, s.y, s.z, s.vx, s.vy, s.vz, held,
            )  # fmt: skip
            clock[DUE] = min(due, due_edges)
            hardest = max(hardest, hardest_edges)
            wait = max(every * step, CALM)
            if hardest > 0.0:
                wait = min(max(math.sqrt(2.0 * SLACK * layers.thickness / hardest), step), wait)
            clock[BEAT] = clock[NOW] + wait if beat else min(clock[BEAT], clock[NOW] + wait)
            if hardest * interval > JOLT:
                alarm_all(layers, substep)
        if beat:
            clock[SINCE] = 0.0
        looks = remaining % every == 0 or clock[SEARCHES] == 0.0
        if looks and not is_foreseen(s, layers.sight.places, every * step, 0.5 * layers.margin):
            clock[AHEAD] = min(clock[NOW] - clock[SOUGHT] + every * step, HORIZON)
            clock[SOUGHT] = clock[NOW]
            run(g.search, team, substep, substeps, step)
            clock[DUE] = 0.0
            clock[SEARCHES] += 1


@kernel
def part_vertices(
    count, first, second, apart, due, force, triangles, thickness, friction, step, interval, now, until, beat,
    inverse_mass, x, y, z, vx, vy, vz, held,
):  # fmt: skip
    """Keep vertices off triangles.

    Returns when the next pair is due [s], and with what acceleration [m/s2] the hardest pressed one approached.
    """
    earliest, hardest, slack = math.inf, 0.0, SLACK * thickness
    for k in range(count):
        if is_asleep(due[k], until, beat):
            earliest = due[k] if now < due[k] < earliest else earliest
            continue
        i, t = first[k], second[k]
        a, b, c = triangles[0, t], triangles[1, t], triangles[2, t]
        gx, gy, gz, wa, wb, wc, over = from_triangle(i, a, b, c, x, y, z)
        depth, nx, ny, nz = depth_of(k, apart, gx, gy, gz, thickness, over)
        if depth > -slack:
            pressing = push(
                k, i, a, b, c, 1.0, -wa, -wb, -wc, depth, slack, nx, ny, nz, force, friction, step, interval, beat,
                inverse_mass, x, y, z, vx, vy, vz, held,
            )  # fmt: skip
            hardest = pressing if pressing > hardest else hardest
            due[k] = TOUCHING
        else:
            let_go(k, force)
            due[k] = now + time_until(-depth, speed_to_triangle(i, a, b, c, vx, vy, vz))
            earliest = due[k] if due[k] < earliest else earliest
    return earliest, hardest


@kernel
def part_edges(
    count, first, second, apart, due, force, edges, thickness, friction, step, interval, now, until, beat,
    inverse_mass, x, y, z, vx, vy, vz, held,
):  # fmt: skip
    """Keep edges apart that cross each other when looked at along the line between their closest points.

    The closest points of others are ends, which are vertices beside triangles. Returns what `part_vertices` does.
    """
    earliest, hardest, slack = math.inf, 0.0, SLACK * thickness
    for k in range(count):
        if is_asleep(due[k], until, beat):
            earliest = due[k] if now < due[k] < earliest else earliest
            continue
        e, f = first[k], second[k]
        a, b, c, d = edges[0, e], edges[1, e], edges[0, f], edges[1, f]
        gx, gy, gz, p, q, crossing = from_edge(a, b, c, d, x, y, z)
        depth, nx, ny, nz = depth_of(k, apart, gx, gy, gz, thickness, crossing)
        if depth > -slack and crossing:
            pressing = push(
                k, a, b, c, d, 1.0 - p, p, q - 1.0, -q, depth, slack, nx, ny, nz, force, friction, step, interval, beat,
                inverse_mass, x, y, z, vx, vy, vz, held,
            )  # fmt: skip
            hardest = pressing if pressing > hardest else hardest
            due[k] = TOUCHING
        else:
            # Edges that are close but don't cross may do so when they have slid a little.
            let_go(k, force)
            due[k] = now + time_until(max(-depth, SLIDE * thickness), speed_to_edge(a, b, c, d, vx, vy, vz))
            earliest = due[k] if due[k] < earliest else earliest
    return earliest, hardest


@inlined
def is_asleep(due, until, beat):
    """Tell whether a pair need not be looked at now."""
    return due >= until or (due == TOUCHING and not beat)


@inlined
def time_until(distance, speed):
    """Least time [s] in which two points cover a distance that now approach with at most this speed."""
    return (math.sqrt(speed * speed + 2.0 * ACCELERATION * distance) - speed) / ACCELERATION


@inlined
def let_go(k, force):
    """End the force between a pair."""
    force[k, 0] = force[k, 1] = force[k, 2] = 0.0


@inlined
def depth_of(k, apart, gx, gy, gz, thickness, across):
    """How much too close pair k is [m], and the unit normal that leads apart, from g between its closest points.

    `apart[k]` is g when the two were last on their proper sides. A g that has turned round
    means that they have passed through each other, unless they went around, as distant ones did that aren't `across`.
    """
    distance = math.sqrt(gx * gx + gy * gy + gz * gz)
    kx, ky, kz = np.float64(apart[k, 0]), np.float64(apart[k, 1]), np.float64(apart[k, 2])
    if distance < GRAZE:
        known = math.sqrt(kx * kx + ky * ky + kz * kz)
        return (thickness, kx / known, ky / known, kz / known) if known > 0.0 else (-thickness, 0.0, 0.0, 0.0)
    scale = 1.0 / distance
    nx, ny, nz = scale * gx, scale * gy, scale * gz
    if gx * kx + gy * ky + gz * kz >= 0.0 or (not across and distance > 0.5 * thickness):
        apart[k, 0], apart[k, 1], apart[k, 2] = gx, gy, gz
        return thickness - distance, nx, ny, nz
    return thickness + distance, -nx, -ny, -nz


@inlined
def push(
    k, a, b, c, d, wa, wb, wc, wd, depth, slack, nx, ny, nz, force, friction, step, interval, beat, inverse_mass,
    x, y, z, vx, vy, vz, held,
):  # fmt: skip
    """Stop pair k, whose points' difference is the weighted sum of four vertices, from approaching along n.

    At a beat, `interval` seconds after the last, `force[k]` [N] is set to what is to act until the next, and added to
    `held`. Returns the acceleration [m/s2] with which the points approached.
    """
    ma, mb, mc, md = wa * inverse_mass[a], wb * inverse_mass[b], wc * inverse_mass[c], wd * inverse_mass[d]
    mobility = wa * ma + wb * mb + wc * mc + wd * md
    if mobility <= 0.0:
        return 0.0
    ux = wa * vx[a] + wb * vx[b] + wc * vx[c] + wd * vx[d]
    uy = wa * vy[a] + wb * vy[b] + wc * vy[c] + wd * vy[d]
    uz = wa * vz[a] + wb * vz[b] + wc * vz[c] + wd * vz[d]
    approach = -(ux * nx + uy * ny + uz * nz)
    # As velocities: what the force has done since the last beat, and what should have been done. Some of the force may
    # be taken back, but nothing pulls; and what gap there is may be closed in the next interval.
    gain = mobility * interval if beat else 0.0
    fx, fy, fz = gain * force[k, 0], gain * force[k, 1], gain * force[k, 2]
    normal = max(fx * nx + fy * ny + fz * nz, 0.0)
    pressed = max(normal + approach + min(depth, 0.0) / interval, 0.0)
    stopped = pressed - normal
    if pressed == 0.0 and normal == 0.0 and depth <= 0.0:
        let_go(k, force)
        return 0.0
    jx, jy, jz = stopped * nx, stopped * ny, stopped * nz
    # What stopped them once is no force to go on with: until the next beat it would part them, and be let go of there.
    going_on = normal + min(LEARNED * stopped, 0.25 * slack / interval)
    tx = ty = tz = 0.0
    if friction > 0.0:
        fx, fy, fz = fx - normal * nx, fy - normal * ny, fz - normal * nz
        tx, ty, tz = fx - ux - approach * nx, fy - uy - approach * ny, fz - uz - approach * nz
        tx, ty, tz = shortened(tx, ty, tz, friction * pressed)
        dx, dy, dz = tx - fx, ty - fy, tz - fz
        jx, jy, jz = jx + dx, jy + dy, jz + dz
        tx, ty, tz = fx + LEARNED * dx, fy + LEARNED * dy, fz + LEARNED * dz
        tx, ty, tz = shortened(tx, ty, tz, friction * going_on)
    lightness = min(1.0 / mobility, MOST_LEVERAGE / max(abs(ma), abs(mb), abs(mc), abs(md)))
    jx, jy, jz = lightness * jx, lightness * jy, lightness * jz
    add(a, ma, jx, jy, jz, vx, vy, vz)
    add(b, mb, jx, jy, jz, vx, vy, vz)
    add(c, mc, jx, jy, jz, vx, vy, vz)
    add(d, md, jx, jy, jz, vx, vy, vz)
    # The step is done again with the new velocity, from where they came too close. Over more than a step that would
    # feed vibrations: stiff springs turn round several times between two beats.
    if depth > 0.0:
        again = min(step, depth / stopped) if stopped > 0.0 else 0.0
        rest = depth - again * stopped
        rest = moved_apart(rest, slack / SLACK, interval) * lightness
        jx, jy, jz = again * jx + rest * nx, again * jy + rest * ny, again * jz + rest * nz
        add(a, ma, jx, jy, jz, x, y, z)
        add(b, mb, jx, jy, jz, x, y, z)
        add(c, mc, jx, jy, jz, x, y, z)
        add(d, md, jx, jy, jz, x, y, z)
    if beat:
        rate = lightness / interval
        fx, fy, fz = rate * (going_on * nx + tx), rate * (going_on * ny + ty), rate * (going_on * nz + tz)
        force[k, 0], force[k, 1], force[k, 2] = fx, fy, fz
        add(a, ma, fx, fy, fz, held[0], held[1], held[2])
        add(b, mb, fx, fy, fz, held[0], held[1], held[2])
        add(c, mc, fx, fy, fz, held[0], held[1], held[2])
        add(d, md, fx, fy, fz, held[0], held[1], held[2])
    return abs(stopped) / interval


@inlined
def shortened(x, y, z, most):
    """A vector, no longer than `most`."""
    squared = x * x + y * y + z * z
    if squared <= most * most:
        return x, y, z
    share = most / math.sqrt(squared)
    return share * x, share * y, share * z


@inlined
def add(i, weight, jx, jy, jz, x, y, z):
    """Add a weighted vector to that of vertex i."""
    x[i] += weight * jx
    y[i] += weight * jy
    z[i] += weight * jz
