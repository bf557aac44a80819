"""Vertices that bones hold: where, and how each kind of solver puts them there."""

import math

from numba import literal_unroll

from cape.kernels.bones import set_pose, to_world, turned, turned_back, velocity_at
from cape.kernels.contact.contact import EXIT
from cape.kernels.contact.shapes import distance_to, forget_places, place
from cape.kernels.jit import driver, inlined

PASSES = 4  # around the colliders that a held vertex is between


@inlined
def goal(points, lift, drift, bones, k, m, time):
    """Where attachment k holds its vertex in the world [m], `time` [s] after the frame's start."""
    x, y, z = points[k, 0], points[k, 1], points[k, 2]
    x += lift[k, 0] + time * drift[k, 0]
    y += lift[k, 1] + time * drift[k, 1]
    z += lift[k, 2] + time * drift[k, 2]
    return to_world(bones[k], x, y, z, m.positions, m.matrices)


@driver
def hold(lo, hi, s, attached, m, time, step):
    """Put the attached ones of vertices lo to hi where they are held; their velocity is what brings them there."""
    if attached is not None:
        inverse_step = 1.0 / step
        for k in range(attached.vertices.size):
            i = attached.vertices[k]
            if i < lo or i >= hi:
                continue
            x, y, z = goal(attached.points, attached.lift, attached.drift, attached.bones, k, m, time)
            # The step has moved the vertex with the last one's velocity; undo it to know where the vertex was.
            s.vx[i] = (x - (s.x[i] - step * s.vx[i])) * inverse_step
            s.vy[i] = (y - (s.y[i] - step * s.vy[i])) * inverse_step
            s.vz[i] = (z - (s.z[i] - step * s.vz[i])) * inverse_step
            s.x[i], s.y[i], s.z[i] = x, y, z


@driver
def aim(lo, hi, s, attached, m, time, step):
    """Give the attached ones of vertices lo to hi the velocity that brings them to where they are held in one step."""
    if attached is not None:
        for k in range(attached.vertices.size):
            i = attached.vertices[k]
            if i < lo or i >= hi:
                continue
            x, y, z = goal(attached.points, attached.lift, attached.drift, attached.bones, k, m, time)
            s.vx[i] = (x - s.x[i]) / step
            s.vy[i] = (y - s.y[i]) / step
            s.vz[i] = (z - s.z[i]) / step


@driver
def hold_rigidly(lo, hi, s, attached, m, time, b, target):
    """Put the attached ones of vertices lo to hi where they are held, with the velocity of that place.

    Rows 0 to 2 of `target` are set to xt, so that v = (x - xt) / b.
    """
    if attached is not None:
        for k in range(attached.vertices.size):
            i, bone = attached.vertices[k], attached.bones[k]
            if i < lo or i >= hi:
                continue
            x, y, z = goal(attached.points, attached.lift, attached.drift, attached.bones, k, m, time)
            vx, vy, vz = velocity_at(bone, x, y, z, m)
            drift = attached.drift[k]
            ux, uy, uz = turned(bone, drift[0], drift[1], drift[2], m.matrices)
            vx, vy, vz = vx + ux, vy + uy, vz + uz
            s.x[i], s.y[i], s.z[i] = x, y, z
            s.vx[i], s.vy[i], s.vz[i] = vx, vy, vz
            target[0, i], target[1, i], target[2, i] = x - b * vx, y - b * vy, z - b * vz


@driver
def lift_held(lo, hi, attached, groups, motion, m, duration):
    """Let the attached ones of vertices lo to hi drift to where they are out of all colliders at the frame's end.

    No faster than `contact.EXIT`. Leaves the bones `m` at the frame's end.
    """
    set_pose(motion.position1, motion.rotation1, m)
    forget_places(groups)
    for k in range(attached.vertices.size):
        i, bone = attached.vertices[k], attached.bones[k]
        if i < lo or i >= hi:
            continue
        point, lift, drift = attached.points[k], attached.lift[k], attached.drift[k]
        x0, y0, z0 = to_world(bone, point[0], point[1], point[2], m.positions, m.matrices)
        x, y, z = x0, y0, z0
        if groups is not None:
            x, y, z = clear(x, y, z, groups, m)
        x, y, z = turned_back(bone, x - x0, y - y0, z - z0, m.matrices)
        x, y, z = (x - lift[0]) / duration, (y - lift[1]) / duration, (z - lift[2]) / duration
        speed = math.sqrt(x * x + y * y + z * z)
        share = EXIT / speed if speed > EXIT else 1.0
        drift[0], drift[1], drift[2] = share * x, share * y, share * z


@driver
def clear(x, y, z, groups, m):
    """The point led out of the thickness of all active colliders [m]."""
    for _ in range(PASSES):
        found = False
        for shapes in literal_unroll(groups):
            for k in range(1, shapes.active[0] + 1):
                c = shapes.active[k]
                place(shapes, c, m.positions, m.matrices)
                distance, nx, ny, nz = distance_to(shapes, c, x, y, z)
                depth = shapes.colliders[c].thickness - distance
                if depth > 0.0:
                    found = True
                    x, y, z = x + depth * nx, y + depth * ny, z + depth * nz
        if not found:
            break
    return x, y, z
