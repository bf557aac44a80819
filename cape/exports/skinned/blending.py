"""Weights that blend a few guesses of many points each, so that what comes out is as near to them as can be."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
LEAST = 1e-10  # of the guesses' mean error: a gain that counts, and what tells apart guesses that are the same
SMALLEST = 1e-300  # an error that can be divided by


def blend(products: FloatArray, most: int, near: FloatArray) -> FloatArray:
    """Weights, none negative and of sum one, of the least sum of squares w^T P w, shape (V, n).

    Where more than `most` are wanted the largest of these stay, fitted once more.

    Args:
        products: for each of V points the scalar products of its n guesses' errors, shape (V, n, n).
        most: how many guesses a point may blend.
        near: weights to begin from, none negative; the nearer, the sooner the best are found, shape (V, n).
    """
    found = _least(products, np.ones(products.shape[:2], bool), near)
    over = np.flatnonzero(np.count_nonzero(found, axis=1) > most)
    if len(over):
        best = np.zeros(found[over].shape, bool)
        np.put_along_axis(best, np.argsort(-found[over], axis=1)[:, :most], True, axis=1)
        found[over] = _least(products[over], best, np.where(best, found[over], 0.0))
    return found


def _least(products: FloatArray, allowed: NDArray[np.bool_], near: FloatArray) -> FloatArray:
    """The same out of those guesses alone that are allowed, by the active sets of Lawson and Hanson ("Solving least
    squares problems", 1974, chapter 23), all points at once.

    They minimise w^T P w + c (1 - sum of w)^2. Whatever c is, that gives the same weights up to their sum: s times
    weights of the error e cost s^2 e + c (1 - s)^2, at best c e / (c + e), which grows with e. With a c of the errors'
    own size it is well conditioned.
    """
    count, size = allowed.shape
    scale = np.maximum(np.trace(products, axis1=1, axis2=2) / size, SMALLEST)
    system = products / scale[:, None, None] + 1.0 + LEAST * np.eye(size)
    weights, free, todo = near.copy(), near > 0.0, np.arange(count)
    for _ in range(3 * size):
        while len(todo):
            now, best = weights[todo], _unbounded(system[todo], free[todo])
            falls = free[todo] & (best <= 0.0)
            # As far towards the best as none becomes negative; one that reaches zero on the way stays there.
            ways = np.divide(now, now - best, out=np.full(now.shape, np.inf), where=falls)
            way = np.minimum(ways.min(axis=1, keepdims=True), 1.0)
            stopped = falls & (ways <= way)
            weights[todo] = np.where(stopped, 0.0, now + way * (best - now))
            free[todo] &= ~stopped
            todo = todo[falls.any(axis=1)]
        # Of those at zero the one that gains most becomes free; where none gains anything the weights are found.
        gains = np.where(allowed & ~free, 1.0 - np.einsum("vij,vj->vi", system, weights), 0.0)
        entering = gains.argmax(axis=1)
        todo = np.flatnonzero(gains.max(axis=1) > LEAST)
        if not len(todo):
            break
        free[todo, entering[todo]] = True
    return weights / weights.sum(axis=1, keepdims=True)


def _unbounded(system: FloatArray, free: NDArray[np.bool_]) -> FloatArray:
    """The free weights whatever their sign, and zero for the others, shape (V, n)."""
    both = free[:, :, None] & free[:, None, :]
    matrix = np.where(both, system, np.eye(free.shape[1]))
    return np.linalg.solve(matrix, free[..., None].astype(float))[..., 0]
