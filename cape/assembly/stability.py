"""The largest step that an explicit solver may take."""

import hashlib
import math
from collections import OrderedDict

import numpy as np
from numpy.typing import NDArray

from cape.assembly.springs import Springs
from cape.cloth.fabric import Fabric
from cape.kernels.cloth.stability import largest_bend_row, power_method

FloatArray = NDArray[np.float64]

ITERATIONS = 150  # of the power method; its estimate then lies within 2 % below the largest frequency
REMEMBERED = 64  # largest steps, of the cloths that came last

_known: OrderedDict[bytes, float] = OrderedDict()


def largest_frequency(springs: Springs, inverse_mass: FloatArray, positions: FloatArray | None) -> float:
    """Estimate the largest angular frequency of a spring network [rad/s], by the power method.

    `inverse_mass` [1/kg] has shape (N,), zero for attached vertices; `positions` [m], shape (N, 3), give the springs'
    directions u. The matrix is M^-1/2 K M^-1/2 with K the linearised stiffness at rest, springs k u u^T and bend
    springs. Without positions it is one that bounds all others: a spring at length L times its rest length resists with
    k (u u^T + (1 - 1 / L) (1 - u u^T)), which is at most k in all directions, however far it is strained or turned.
    """
    first, second, stiffness = springs.first, springs.second, springs.stiffness
    if positions is None:
        direction = np.repeat(np.eye(3), len(first), axis=0)
        first, second, stiffness = np.tile(first, 3), np.tile(second, 3), np.tile(stiffness, 3)
    else:
        direction = positions[second] - positions[first]
        direction /= np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-12)
    root = np.sqrt(inverse_mass)
    start = np.random.default_rng(0).standard_normal((len(root), 3)) * (root > 0)[:, None]
    largest = power_method(
        start, np.empty_like(start), ITERATIONS, root, first, second, stiffness, direction,
        springs.bend_vertices, springs.bend_coefficients, springs.bend_stiffness,
    )  # fmt: skip
    return math.sqrt(max(float(largest), 0.0))


def stable_step(frequency: float, damping_rate: float) -> float:
    """Largest stable step of symplectic Euler [s] for x'' + c x' + w^2 x = 0, infinite for frequency 0.

    `frequency` is w [rad/s], `damping_rate` is c [1/s]. With forces taken at the old state the amplification has the
    characteristic polynomial q^2 - (2 - c dt - w^2 dt^2) q + 1 - c dt; stability ends at q = -1, so
    w^2 dt^2 + 2 c dt = 4.
    """
    if frequency <= 0.0:
        return math.inf
    return (math.hypot(damping_rate, 2.0 * frequency) - damping_rate) / frequency**2


def largest_step(springs: Springs, fabric: Fabric, inverse_mass: FloatArray, positions: FloatArray | None) -> float:
    """Largest stable step of symplectic Euler [s], for a cloth at rest or, without positions, strained at will.

    Arrays are as in `largest_frequency`.

    It is remembered for as long as stiffness, damping and mass stay as they are.
    """
    digest = hashlib.sha256(repr((fabric.damping_time, fabric.bend_damping_time)).encode())
    places = np.empty(0) if positions is None else positions
    for array in (springs.first, springs.second, springs.stiffness, springs.bend_stiffness, inverse_mass, places):
        digest.update(np.ascontiguousarray(array).tobytes())
    key = digest.digest()
    step = _known.get(key)
    if step is None:
        frequency = largest_frequency(springs, inverse_mass, positions)
        bend_squared = largest_bend_row(
            inverse_mass, springs.bend_vertices, springs.bend_coefficients, springs.bend_stiffness,
            np.empty_like(inverse_mass),
        )  # fmt: skip
        rate = fabric.damping_time * frequency**2 + fabric.bend_damping_time * float(bend_squared)
        step = _known[key] = stable_step(frequency, rate)
        if len(_known) > REMEMBERED:
            _known.popitem(last=False)
    return step
