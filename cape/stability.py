"""The largest step that an explicit solver may take."""

import math

import numpy as np
from numpy.typing import NDArray

from cape.fabric import Fabric
from cape.springs import Springs

FloatArray = NDArray[np.float64]

ITERATIONS = 150  # of the power method; its estimate then lies within 2 % below the largest frequency


def largest_frequency(springs: Springs, inverse_mass: FloatArray, positions: FloatArray) -> float:
    """Estimate the largest angular frequency of a spring network at rest [rad/s], by the power method.

    `inverse_mass` [1/kg] has shape (N,), zero for attached vertices; `positions` [m], shape (N, 3), give the springs'
    directions. The matrix is M^-1/2 K M^-1/2 with K the linearised stiffness, springs u u^T k and bend springs.
    """
    first, second, stiffness, _ = springs.pairs()
    start, offset, bend = springs.triples()
    middle, end = start + offset, start + 2 * offset
    direction = positions[second] - positions[first]
    direction /= np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-12)
    root = np.sqrt(inverse_mass)[:, None]
    count = len(inverse_mass)
    ends = np.concatenate([first, second, start, middle, end])

    def stiffness_times(v: FloatArray) -> FloatArray:
        along = stiffness * np.einsum("ij,ij->i", v[second] - v[first], direction)
        pull = along[:, None] * direction
        curl = bend[:, None] * (v[start] - 2.0 * v[middle] + v[end])
        forces = np.concatenate([-pull, pull, curl, -2.0 * curl, curl])
        sums = [np.bincount(ends, weights=forces[:, k], minlength=count) for k in range(3)]
        return np.stack(sums, axis=1).astype(float)

    v = np.random.default_rng(0).standard_normal((count, 3)) * (root > 0)
    squared = 0.0
    for _ in range(ITERATIONS):
        norm = float(np.linalg.norm(v))
        if norm == 0.0:
            return 0.0
        v = v / norm
        image = root * stiffness_times(root * v)
        squared = float(np.sum(v * image))
        v = image
    return math.sqrt(max(squared, 0.0))


def stable_step(frequency: float, damping_rate: float) -> float:
    """Largest stable step of symplectic Euler [s] for x'' + c x' + w^2 x = 0, infinite for frequency 0.

    `frequency` is w [rad/s], `damping_rate` is c [1/s]. With forces taken at the old state the amplification has the
    characteristic polynomial q^2 - (2 - c dt - w^2 dt^2) q + 1 - c dt; stability ends at q = -1, so
    w^2 dt^2 + 2 c dt = 4.
    """
    if frequency <= 0.0:
        return math.inf
    return (math.hypot(damping_rate, 2.0 * frequency) - damping_rate) / frequency**2


def largest_step(springs: Springs, fabric: Fabric, inverse_mass: FloatArray, positions: FloatArray) -> float:
    """Largest stable step of symplectic Euler for a cloth at rest [s]; arrays as in `largest_frequency`."""
    frequency = largest_frequency(springs, inverse_mass, positions)
    # A uniform chain of second differences has 16 k / m as its largest squared frequency; both directions add up.
    bend_squared = 16.0 * float((springs.bend_stiffness.max(axis=1) * inverse_mass.max()).sum())
    rate = fabric.damping_time * frequency**2 + fabric.bend_damping_time * bend_squared
    return stable_step(frequency, rate)
