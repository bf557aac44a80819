"""Vertices that may get no farther than a distance from where bones carry them, or behind that.

A vertex x with velocity v that a step of h takes out of the sphere around its animated position a, which moves at u, is
put back onto it, and loses what of its velocity has led there:

    n = (x - a) / |x - a|,   e = |x - a| - d,   w = max((v - u) . n, 0)
    v -= min(w, e / h) n,   x -= min(e, h (w + EXIT)) n

What lies farther out, as where bones have jumped, comes back no faster than contact moves vertices. A backstop is a
sphere of radius r behind a, whose centre lies at b = a - (s + r) N for the unit normal N there: the same holds with n
turned, as a vertex is kept out of it. With N = M / |M|, where M is the mean of the normals that bones carry, N moves at
(M' - (M' . N) N) / |M|.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.bones import MotionRoom, turned
from cape.kernels.contact.contact import EXIT
from cape.kernels.jit import inlined, unit
from cape.kernels.solve.attachments import Attached, carried, carrying_velocity
from cape.kernels.state import State

Array = NDArray[np.floating]


class Confined(NamedTuple):
    """Vertices (n,) with bones that carry their animated positions, and the normals there (m, 3), in the frames of the
    bones like points.

    They get no farther from there than `most` [m] (n,); `behind` it at a distance [m] (n,) spheres of `radius` [m] (n,)
    begin that keep them off.
    """

    animated: Attached
    normals: Array
    most: Array
    behind: Array
    radius: Array


class Confining(NamedTuple):
    """A cloth, `inverse_mass` [1/kg] (N,), zero for attached vertices, and what is confined of it."""

    state: State
    inverse_mass: Array
    confined: Confined
    bones: MotionRoom


@unit
def keep_near(g, team, substep, substeps, step):
    """Keep a thread's vertices within their distances from their animated positions."""
    s, animated, most, m = g.state, g.confined.animated, g.confined.most, g.bones
    for k in range(animated.vertices.size):
        i = animated.vertices[k]
        if i < team.lo or i >= team.hi or g.inverse_mass[i] == 0.0 or most[k] == math.inf:
            continue
        ax, ay, az = carried(animated, animated.blend, k, 0.0, 0.0, 0.0, m)
        x, y, z = s.x[i] - ax, s.y[i] - ay, s.z[i] - az
        squared = x * x + y * y + z * z
        if squared <= most[k] * most[k]:
            continue
        distance = math.sqrt(squared)
        u, v, w = carrying_velocity(animated, animated.blend, k, ax, ay, az, m)
        put_back(s, i, x / distance, y / distance, z / distance, distance - most[k], u, v, w, step)


@unit
def keep_in_front(g, team, substep, substeps, step):
    """Keep a thread's vertices out of the spheres behind their animated positions."""
    s, animated, m = g.state, g.confined.animated, g.bones
    for k in range(animated.vertices.size):
        i, behind, radius = animated.vertices[k], g.confined.behind[k], g.confined.radius[k]
        if i < team.lo or i >= team.hi or g.inverse_mass[i] == 0.0 or behind == math.inf:
            continue
        ax, ay, az = carried(animated, animated.blend, k, 0.0, 0.0, 0.0, m)
        nx, ny, nz, px, py, pz = carried_normal(g.confined.normals, animated, animated.blend, k, m)
        far = behind + radius
        x, y, z = ax - far * nx - s.x[i], ay - far * ny - s.y[i], az - far * nz - s.z[i]
        squared = x * x + y * y + z * z
        if squared >= radius * radius:
            continue
        distance = math.sqrt(squared)
        u, v, w = carrying_velocity(animated, animated.blend, k, ax, ay, az, m)
        u, v, w = u - far * px, v - far * py, w - far * pz
        if distance > 0.0:
            x, y, z = x / distance, y / distance, z / distance
        else:
            x, y, z = -nx, -ny, -nz  # in the very middle
        put_back(s, i, x, y, z, radius - distance, u, v, w, step)


@inlined
def put_back(s, i, nx, ny, nz, beyond, u, v, w, step):
    """Put vertex i, which is `beyond` [m] too far along the unit vector n, back to what moves at (u, v, w) [m/s]."""
    away = max((s.vx[i] - u) * nx + (s.vy[i] - v) * ny + (s.vz[i] - w) * nz, 0.0)
    back, lost = min(beyond, step * (away + EXIT)), min(away, beyond / step)
    s.x[i] -= back * nx
    s.y[i] -= back * ny
    s.z[i] -= back * nz
    s.vx[i] -= lost * nx
    s.vy[i] -= lost * ny
    s.vz[i] -= lost * nz


@inlined
def carried_normal(normals, animated, blend, k, m):
    """The unit normal of attachment k in the world, and how it changes [1/s]."""
    x, y, z, dx, dy, dz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    first, last = k, k + 1
    if blend is not None:
        first, last = blend.starts[k], blend.starts[k + 1]
    for j in range(first, last):
        bone = animated.bones[j]
        px, py, pz = turned(bone, normals[j, 0], normals[j, 1], normals[j, 2], m.matrices)
        weight, spin = share_of(blend, j), m.spin[bone]
        px, py, pz = weight * px, weight * py, weight * pz
        x, y, z = x + px, y + py, z + pz
        dx += spin[1] * pz - spin[2] * py
        dy += spin[2] * px - spin[0] * pz
        dz += spin[0] * py - spin[1] * px
    scale = 1.0 / max(math.sqrt(x * x + y * y + z * z), 1e-12)
    x, y, z, dx, dy, dz = scale * x, scale * y, scale * z, scale * dx, scale * dy, scale * dz
    along = dx * x + dy * y + dz * z
    return x, y, z, dx - along * x, dy - along * y, dz - along * z


@inlined
def share_of(blend, j):
    """The weight of entry j, 1 where each vertex has one bone."""
    if blend is None:
        return 1.0
    return blend.weights[j]
