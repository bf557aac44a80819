"""The rotations nearest to many matrices, found from some that are nearly so.

What is nearest to M has the greatest trace of R^T M. Of the places where that is stationary one alone is a maximum
(Umeyama, "Least-squares estimation of transformation parameters between two point patterns", IEEE Transactions on
Pattern Analysis and Machine Intelligence 13, 4, 1991), so Newton's steps that end at one need no other proof. All
matrices take a step at once, which costs a fraction of their singular values; those that need these get them.
"""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
STEPS = 6  # their number of right digits doubles with each
EXACT = 1e-7  # [rad] by which a last step turns: a further one would turn by its square
LEAST = 1e-9  # of the cube of the mean second derivative: a determinant of which a step can be taken


def nearest_rotations(matrices: FloatArray, near: FloatArray, *, last: float = EXACT) -> FloatArray:
    """The rotations nearest to N matrices, all as rows: [a, n] is what the n-th makes of axis a; shape (3, N, 3).

    Args:
        matrices: shape (3, N, 3).
        near: rotations to begin from, shape (3, N, 3).
        last: no step is taken after one that turns by less [rad]: what is left is about its square.
    """
    # What is worked out for all at once is quickest where they are side by side in memory.
    matrices, found = np.ascontiguousarray(matrices.swapaxes(1, 2)), np.array(near.swapaxes(1, 2), order="C")
    todo, hard = np.arange(matrices.shape[2]), []
    for _ in range(STEPS):
        if not len(todo):
            break
        own, now = (each if len(todo) == each.shape[2] else each[:, :, todo] for each in (matrices, found))
        turns, certain = _step((now[:, None] * own).sum(axis=2))
        found[:, :, todo] = _turned(now, turns)
        hard.append(todo[~certain])
        todo = todo[certain & (np.abs(turns).max(axis=0) > last)]
    rest = np.concatenate([*hard, todo])
    if len(rest):
        found[:, :, rest] = _by_singular_values(matrices[:, :, rest])
    return found.swapaxes(1, 2)


def _step(products: FloatArray) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Newton's step from R^T M as a rotation vector, (3, N), and whether it leads up to a maximum, (N,)."""
    (a, p, q), (p2, b, r), (q2, r2, c) = products
    gradient = np.stack([r2 - r, q - q2, p2 - p])
    # Minus the second derivative: the trace, less the symmetric part.
    xx, yy, zz = b + c, a + c, a + b
    xy, xz, yz = -0.5 * (p + p2), -0.5 * (q + q2), -0.5 * (r + r2)
    inverse_xx, inverse_xy, inverse_xz = yy * zz - yz * yz, xz * yz - xy * zz, xy * yz - xz * yy
    inverse_yy, inverse_yz, inverse_zz = xx * zz - xz * xz, xy * xz - xx * yz, xx * yy - xy * xy
    determinant = xx * inverse_xx + xy * inverse_xy + xz * inverse_xz
    certain = (xx > 0.0) & (inverse_zz > 0.0) & (determinant > LEAST * ((xx + yy + zz) / 3.0) ** 3)
    gradient *= np.divide(1.0, determinant, out=np.zeros_like(determinant), where=certain)
    x, y, z = gradient
    return np.stack(
        [
            inverse_xx * x + inverse_xy * y + inverse_xz * z,
            inverse_xy * x + inverse_yy * y + inverse_yz * z,
            inverse_xz * x + inverse_yz * y + inverse_zz * z,
        ]
    ), certain


def _turned(rows: FloatArray, turns: FloatArray) -> FloatArray:
    """Rotations as rows, (3, 3, N), turned about their own axes, as far as rotation vectors say up to their cube: by
    Cayley's formula."""
    x, y, z = 0.5 * turns
    scale = 2.0 / (1.0 + x * x + y * y + z * z)
    sx, sy, sz = scale * x, scale * y, scale * z
    turn = np.array(
        [
            [1.0 - y * sy - z * sz, x * sy - sz, x * sz + sy],
            [x * sy + sz, 1.0 - x * sx - z * sz, y * sz - sx],
            [x * sz - sy, y * sz + sx, 1.0 - x * sx - y * sy],
        ]
    )
    return (rows[:, None] * turn[:, :, None]).sum(axis=0)


def _by_singular_values(matrices: FloatArray) -> FloatArray:
    """The same from nothing, whatever the matrices are."""
    u, _, vt = np.linalg.svd(matrices.transpose(2, 1, 0))
    u[:, :, 2] *= np.linalg.det(u @ vt)[:, None]
    return (u @ vt).transpose(2, 1, 0)
