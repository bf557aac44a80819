"""The largest step that an explicit solver may take."""

import hashlib
import math
from collections import OrderedDict
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assembly.membrane import FAR_STRETCH, USUAL_STRETCH, stiffened
from cape.assembly.springs import Springs
from cape.cloth.fabric import Fabric

FloatArray = NDArray[np.float64]

STEPS = 60  # of Lanczos' method at most; some 30 are usual
SETTLED = 1e-4  # relative change of the largest frequency's square in `BETWEEN` steps at which it is known
BETWEEN = 5
REMEMBERED = 64  # largest steps, of the cloths that came last

_known: OrderedDict[bytes, float] = OrderedDict()


class Ground(NamedTuple):
    """What holds vertices softly where they are: stiffness [N/m] and damping [N s/m] of each, shape (N,)."""

    stiffness: FloatArray
    damping: FloatArray


def largest_frequency(
    springs: Springs, inverse_mass: FloatArray, positions: FloatArray | None, ground: Ground | None = None
) -> float:
    """Estimate the largest angular frequency of a cloth [rad/s], by Lanczos' method.

    `inverse_mass` [1/kg] has shape (N,), zero for attached vertices; `positions` [m], shape (N, 3), give the springs'
    directions u. The matrix is M^-1/2 K M^-1/2 with K the linearised stiffness at rest, springs k u u^T and bend
    springs. Without positions it is one that bounds all others: a spring at length L times its rest length resists with
    k (u u^T + (1 - 1 / L) (1 - u u^T)), which is at most k in all directions, however far it is strained or turned.
    That is the same along all three axes, of which one is enough. A membrane, which grows stiffer without end as it is
    stretched, is taken to be stretched by `USUAL_STRETCH` with positions, and by `FAR_STRETCH` without.
    """
    membrane, gradients = springs.membrane, None
    if membrane is not None and positions is not None:
        gradients = membrane.gradients(positions)
        gradients *= math.sqrt(stiffened(USUAL_STRETCH)) / np.linalg.norm(gradients, axis=2, keepdims=True)
    direction = np.ones((len(springs.first), 1))
    if positions is not None:
        direction = positions[springs.second] - positions[springs.first]
        direction /= np.maximum(np.linalg.norm(direction, axis=1, keepdims=True), 1e-12)
    root = np.sqrt(inverse_mass)[:, None]
    start = np.random.default_rng(0).standard_normal((len(root), direction.shape[1])) * (root > 0)

    def product(vectors: FloatArray) -> FloatArray:
        moved = root * vectors
        pushed = _stiffness_times(springs, direction, moved)
        if membrane is not None and gradients is None:
            pushed += stiffened(FAR_STRETCH) * membrane.bounding_forces(moved)
        elif membrane is not None and gradients is not None:
            pushed += membrane.forces_between(moved, gradients)
        if ground is not None:
            pushed += ground.stiffness[:, None] * moved
        return root * pushed

    return math.sqrt(max(largest_eigenvalue(product, start), 0.0))


def _stiffness_times(springs: Springs, direction: FloatArray, moved: FloatArray) -> FloatArray:
    """Forces against small displacements (N, D), along the springs' directions (E, D) and against bending."""
    first, second, count = springs.first, springs.second, len(moved)
    along = springs.stiffness * np.einsum("ed,ed->e", direction, moved[second] - moved[first])
    result = np.empty_like(moved)
    for axis in range(moved.shape[1]):
        pull = along * direction[:, axis]
        column = np.bincount(second, pull, count) - np.bincount(first, pull, count)
        if len(springs.bend_stiffness):
            members, coefficients = springs.bend_vertices, springs.bend_coefficients
            curl = np.einsum("km,km->k", coefficients, moved[members, axis])
            spread = coefficients * (springs.bend_stiffness * curl)[:, None]
            column += np.bincount(members.ravel(), spread.ravel(), count)
        result[:, axis] = column
    return result


def largest_eigenvalue(
    product: Callable[[FloatArray], FloatArray], start: FloatArray, *, settled: float = SETTLED
) -> float:
    """Largest eigenvalue of a positive semidefinite matrix, from below (Golub and Van Loan 2013, algorithm 10.1.1).

    It is known when it changes by less than the share `settled` in `BETWEEN` steps.

    Without orthogonalising anew, which costs copies of the largest eigenvalue and no accuracy of it. Sums are numpy's
    own, which have the same bits on any number of cores.
    """
    norm = math.sqrt(float((start * start).sum()))
    if norm == 0.0:
        return 0.0
    before, vector, beta = np.zeros_like(start), start / norm, 0.0
    diagonal: list[float] = []
    beside: list[float] = []
    largest = 0.0
    for step in range(1, STEPS + 1):
        image = product(vector)
        alpha = float((image * vector).sum())
        image -= alpha * vector + beta * before
        diagonal.append(alpha)
        beta = math.sqrt(float((image * image).sum()))
        if step % BETWEEN == 0 or beta <= 1e-12 * alpha:
            known, largest = largest, _largest_of_tridiagonal(diagonal, beside)
            if beta <= 1e-12 * alpha or largest - known <= settled * largest:
                return largest
        beside.append(beta)
        before, vector = vector, image / beta
    return largest


def _largest_of_tridiagonal(diagonal: list[float], beside: list[float]) -> float:
    matrix = np.diag(diagonal) + np.diag(beside, 1) + np.diag(beside, -1)
    return float(np.linalg.eigvalsh(matrix)[-1])


def _largest_bend_row(springs: Springs, inverse_mass: FloatArray) -> float:
    """Gershgorin's bound of the largest eigenvalue of M^-1 K for the bend springs alone [1/s2]."""
    if len(springs.bend_stiffness) == 0:
        return 0.0
    size = np.abs(springs.bend_coefficients)
    entries = springs.bend_stiffness[:, None] * size * size.sum(axis=1, keepdims=True)
    rows = np.bincount(springs.bend_vertices.ravel(), entries.ravel(), len(inverse_mass))
    return float((rows * inverse_mass).max())


def stable_step(frequency: float, damping_rate: float) -> float:
    """Largest stable step of symplectic Euler [s] for x'' + c x' + w^2 x = 0, infinite for frequency 0.

    `frequency` is w [rad/s], `damping_rate` is c [1/s]. With forces taken at the old state the amplification has the
    characteristic polynomial q^2 - (2 - c dt - w^2 dt^2) q + 1 - c dt; stability ends at q = -1, so
    w^2 dt^2 + 2 c dt = 4.
    """
    if frequency <= 0.0:
        return math.inf
    return (math.hypot(damping_rate, 2.0 * frequency) - damping_rate) / frequency**2


def largest_step(
    springs: Springs,
    fabric: Fabric,
    inverse_mass: FloatArray,
    positions: FloatArray | None,
    ground: Ground | None = None,
) -> float:
    """Largest stable step of symplectic Euler [s], for a cloth at rest or, without positions, strained at will.

    Arrays are as in `largest_frequency`; `ground` is None where no vertex is held softly.

    It is remembered for as long as stiffness, damping and mass stay as they are.
    """
    digest = hashlib.sha256(repr((fabric.damping_time, fabric.bend_damping_time)).encode())
    places = np.empty(0) if positions is None else positions
    arrays = [springs.first, springs.second, springs.stiffness, springs.bend_stiffness, inverse_mass, places]
    if springs.membrane is not None:
        arrays += [springs.membrane.area, springs.membrane.stiffness, springs.membrane.slopes]
    if ground is not None:
        arrays += ground
    for array in arrays:
        digest.update(np.ascontiguousarray(array).tobytes())
    key = digest.digest()
    step = _known.get(key)
    if step is None:
        frequency = largest_frequency(springs, inverse_mass, positions, ground)
        bend_squared = _largest_bend_row(springs, inverse_mass)
        rate = fabric.damping_time * frequency**2 + fabric.bend_damping_time * bend_squared
        if ground is not None:
            rate += float((ground.damping * inverse_mass).max())
        step = _known[key] = stable_step(frequency, rate)
        if len(_known) > REMEMBERED:
            _known.popitem(last=False)
    return step
