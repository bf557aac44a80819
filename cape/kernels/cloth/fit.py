"""Small least-squares problems, many at once: with weights that must not be negative, and what others are solved by."""

import math

from cape.kernels.jit import routine

STILL = 1e-13  # change of all weights in a sweep at which there is nothing more to gain
FIRST_RIDGE = 1.0
FALL = 0.9  # of the ridge from sweep to sweep
TURNS = 30  # sweeps of rotations at most; some six are usual
DIAGONAL = 1e-24  # squares beside a matrix's diagonal over that of its trace, at which it is one


@routine
def fit_weights(vectors, target, sweeps, ridge, normal, wanted, weights):
    """Find weights q >= 0 of S unit vectors (P, S, K) whose sum is nearest to a target (K,), for each of P problems.

    Projected Gauss-Seidel on the normal equations, whose diagonal a ridge raises so that the weights are unique. It
    falls to `ridge`: under a small one from the start the first of vectors that do the same would keep all the weight.
    Filled: `weights` (P, S); `normal` (S, S) and `wanted` (S,) are room.
    """
    count, dimensions = vectors.shape[1], vectors.shape[2]
    for p in range(vectors.shape[0]):
        for s in range(count):
            weights[p, s] = 0.0
            wanted[s] = 0.0
            for k in range(dimensions):
                wanted[s] += vectors[p, s, k] * target[k]
            for r in range(count):
                normal[s, r] = 0.0
                for k in range(dimensions):
                    normal[s, r] += vectors[p, s, k] * vectors[p, r, k]
        raised = FIRST_RIDGE
        for _ in range(sweeps):
            raised = max(FALL * raised, ridge)
            change = 0.0
            for s in range(count):
                residual = wanted[s] + weights[p, s]
                for r in range(count):
                    residual -= normal[s, r] * weights[p, r]
                weight = max(residual / (1.0 + raised), 0.0)
                change = max(change, abs(weight - weights[p, s]))
                weights[p, s] = weight
            if change < STILL:
                break


@routine
def eigenvalues(matrix):
    """Least and largest eigenvalue of a symmetric matrix, whose lower half is given and changed, by Jacobi's method.

    Golub and Van Loan 2013, section 8.5.
    """
    n = matrix.shape[0]
    for _ in range(TURNS):
        beside, trace = 0.0, 0.0
        for p in range(n):
            trace += matrix[p, p]
            for q in range(p):
                beside += matrix[p, q] * matrix[p, q]
        if beside <= DIAGONAL * trace * trace:
            break
        for p in range(1, n):
            for q in range(p):
                if matrix[p, q] != 0.0:
                    turn_off(matrix, p, q)
    least = largest = matrix[0, 0]
    for p in range(1, n):
        least, largest = min(least, matrix[p, p]), max(largest, matrix[p, p])
    return least, largest


@routine
def turn_off(matrix, p, q):
    """Rotate a symmetric matrix, by its lower half, so that its entry (p, q) below the diagonal vanishes."""
    apart = (matrix[q, q] - matrix[p, p]) / (2.0 * matrix[p, q])
    tangent = 1.0 / (abs(apart) + math.sqrt(apart * apart + 1.0))
    tangent = tangent if apart >= 0.0 else -tangent
    cosine = 1.0 / math.sqrt(tangent * tangent + 1.0)
    sine = tangent * cosine
    matrix[p, p] -= tangent * matrix[p, q]
    matrix[q, q] += tangent * matrix[p, q]
    matrix[p, q] = 0.0
    for k in range(matrix.shape[0]):
        if k != p and k != q:
            i, j = max(k, p), min(k, p)
            u, v = max(k, q), min(k, q)
            one, two = matrix[i, j], matrix[u, v]
            matrix[i, j], matrix[u, v] = cosine * one - sine * two, sine * one + cosine * two


@routine
def factorise(matrix):
    """Cholesky's factor of a positive definite matrix, over its lower half."""
    for j in range(matrix.shape[0]):
        for k in range(j):
            matrix[j, j] -= matrix[j, k] * matrix[j, k]
        matrix[j, j] = math.sqrt(matrix[j, j])
        for i in range(j + 1, matrix.shape[0]):
            for k in range(j):
                matrix[i, j] -= matrix[i, k] * matrix[j, k]
            matrix[i, j] /= matrix[j, j]


@routine
def solve(factor, wanted):
    """Solve for a vector, in place, with a matrix of which the factor is given."""
    n = wanted.size
    for i in range(n):
        for k in range(i):
            wanted[i] -= factor[i, k] * wanted[k]
        wanted[i] /= factor[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            wanted[i] -= factor[k, i] * wanted[k]
        wanted[i] /= factor[i, i]
