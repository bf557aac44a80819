"""Unit quaternions (w, x, y, z), vectorised: every function works on arrays of shape (..., 4) and broadcasts."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


def multiply(a: FloatArray, b: FloatArray) -> FloatArray:
    """Hamilton product a b: the rotation b followed by a, shape (..., 4)."""
    aw, ax, ay, az = _parts(a)
    bw, bx, by, bz = _parts(b)
    product = np.empty((*np.broadcast_shapes(aw.shape, bw.shape), 4))
    product[..., 0] = aw * bw - ax * bx - ay * by - az * bz
    product[..., 1] = aw * bx + ax * bw + ay * bz - az * by
    product[..., 2] = aw * by - ax * bz + ay * bw + az * bx
    product[..., 3] = aw * bz + ax * by - ay * bx + az * bw
    return product


def conjugate(q: FloatArray) -> FloatArray:
    """The inverse rotation of unit quaternions, shape (..., 4)."""
    return q * np.array([1.0, -1.0, -1.0, -1.0])


def normalize(q: FloatArray) -> FloatArray:
    """Scale to unit length; a zero quaternion gives NaN."""
    return q / _lengths(q)


def rotate(q: FloatArray, vectors: ArrayLike) -> FloatArray:
    """Rotate vectors (..., 3) by unit quaternions (..., 4), in the unit of the vectors."""
    (w, x, y, z), vectors = _parts(q), np.asarray(vectors)
    vx, vy, vz = (vectors[..., k] for k in range(vectors.shape[-1]))  # sooner than by np.moveaxis
    # v + w t + u x t with u = (x, y, z) and t = 2 u x v: 18 products, against 28 of two quaternion products.
    tx, ty, tz = 2 * (y * vz - z * vy), 2 * (z * vx - x * vz), 2 * (x * vy - y * vx)
    rotated = np.empty((*np.broadcast_shapes(w.shape, vx.shape), 3))
    rotated[..., 0] = vx + w * tx + y * tz - z * ty
    rotated[..., 1] = vy + w * ty + z * tx - x * tz
    rotated[..., 2] = vz + w * tz + x * ty - y * tx
    return rotated


def from_rotation_vector(vectors: ArrayLike) -> FloatArray:
    """Rotation about each vector's direction by its length [rad]; (..., 3) to (..., 4)."""
    vectors = np.asarray(vectors, dtype=float)
    half = np.linalg.norm(vectors, axis=-1, keepdims=True) / 2
    # np.sinc(x) is sin(pi x) / (pi x), well defined for the zero rotation.
    return np.concatenate([np.cos(half), vectors * np.sinc(half / np.pi) / 2], axis=-1)


def from_z_axis(directions: ArrayLike) -> FloatArray:
    """Unit quaternions of the shortest rotations that take +Z to the directions, shape (..., 3) to (..., 4).

    A zero direction gives the identity; for -Z, where any horizontal axis will do, it is X.
    """
    x, y, z = np.moveaxis(np.asarray(directions, dtype=float), -1, 0)
    horizontal = np.hypot(x, y)
    angles = np.arctan2(horizontal, z)
    axes = np.stack([-y, x, np.zeros_like(x)], axis=-1)
    safe = np.where(horizontal > 0, horizontal, 1.0)[..., None]
    axes = np.where(horizontal[..., None] > 0, axes / safe, np.array([1.0, 0.0, 0.0]))
    return from_rotation_vector(axes * angles[..., None])


def to_rotation_vector(q: FloatArray) -> FloatArray:
    """Axis times angle [rad], the angle at most pi; (..., 4) to (..., 3). The inverse of `from_rotation_vector`."""
    q = np.where(q[..., :1] < 0.0, -q, q)
    length = np.linalg.norm(q[..., 1:], axis=-1, keepdims=True)
    angle = 2.0 * np.arctan2(length, q[..., :1])
    return np.where(length > 1e-12, angle / np.maximum(length, 1e-300), 2.0) * q[..., 1:]


def from_euler(angles: ArrayLike, axes: str) -> FloatArray:
    """Rotations from angles about moving axes.

    Args:
        angles: one angle for each letter of `axes` [rad], shape (..., len(axes)).
        axes: the axes in the order in which they are applied, each about the frame that those before it turned
            (intrinsic), such as "zxy"; any number of letters, "" for no rotation.

    Returns:
        Unit quaternions of R(axes[0]) R(axes[1]) ..., shape (..., 4).
    """
    angles = np.asarray(angles, dtype=float)
    halves = np.moveaxis(angles, -1, 0) / 2
    w, x, y, z = np.ones(angles.shape[:-1]), *np.zeros((3, *angles.shape[:-1]))
    for axis, half in zip(axes.lower(), halves, strict=True):
        c, s = np.cos(half), np.sin(half)
        if axis == "x":
            w, x, y, z = w * c - x * s, x * c + w * s, y * c + z * s, z * c - y * s
        elif axis == "y":
            w, x, y, z = w * c - y * s, x * c - z * s, y * c + w * s, z * c + x * s
        else:
            w, x, y, z = w * c - z * s, x * c + y * s, y * c - x * s, z * c + w * s
    return np.stack([w, x, y, z], axis=-1)


def to_euler(q: FloatArray, axes: str) -> FloatArray:
    """Angles about three different moving axes, the inverse of `from_euler`.

    Where the middle angle is +-90 degrees only a combination of the other two is determined; the three that are
    returned still make the same rotation.

    Args:
        q: unit quaternions, shape (..., 4).
        axes: three different letters, such as "zxy".

    Returns:
        Angles [rad], the middle one in [-pi/2, pi/2], the others in [-pi, pi], shape (..., 3).
    """
    i, j, k = ("xyz".index(axis) for axis in axes.lower())
    sign = 1.0 if (j - i) % 3 == 1 else -1.0
    matrix = to_matrix(q)
    first = np.arctan2(-sign * matrix[..., j, k], matrix[..., k, k])
    c, s = np.cos(first), sign * np.sin(first)
    # Undoing the first rotation before reading off the others keeps all three consistent near the singularity.
    second = np.arctan2(sign * matrix[..., i, k], c * matrix[..., k, k] - s * matrix[..., j, k])
    third = np.arctan2(
        sign * (c * matrix[..., j, i] + s * matrix[..., k, i]), c * matrix[..., j, j] + s * matrix[..., k, j]
    )
    return np.stack([first, second, third], axis=-1)


def to_matrix(q: FloatArray) -> FloatArray:
    """Rotation matrices of unit quaternions; (..., 4) to (..., 3, 3)."""
    w, x, y, z = _parts(q)
    matrix = np.empty((*w.shape, 3, 3))
    matrix[..., 0, 0], matrix[..., 0, 1] = 1 - 2 * (y * y + z * z), 2 * (x * y - w * z)
    matrix[..., 0, 2], matrix[..., 1, 0] = 2 * (x * z + w * y), 2 * (x * y + w * z)
    matrix[..., 1, 1], matrix[..., 1, 2] = 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)
    matrix[..., 2, 0], matrix[..., 2, 1] = 2 * (x * z - w * y), 2 * (y * z + w * x)
    matrix[..., 2, 2] = 1 - 2 * (x * x + y * y)
    return matrix


def from_matrix(matrix: ArrayLike) -> FloatArray:
    """Unit quaternions with w >= 0 of rotation matrices; (..., 3, 3) to (..., 4).

    Divides by the largest of the four components, so no rotation is singular (Shepperd 1978, "Quaternion from
    rotation matrix").
    """
    m = np.asarray(matrix, dtype=float)
    xx, yy, zz = m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]
    # Row n holds 4 q_n q, for n = w, x, y, z.
    products = np.empty((*m.shape[:-2], 4, 4))
    products[..., 0, 0], products[..., 1, 1] = 1 + xx + yy + zz, 1 + xx - yy - zz
    products[..., 2, 2], products[..., 3, 3] = 1 - xx + yy - zz, 1 - xx - yy + zz
    products[..., 0, 1] = products[..., 1, 0] = m[..., 2, 1] - m[..., 1, 2]
    products[..., 0, 2] = products[..., 2, 0] = m[..., 0, 2] - m[..., 2, 0]
    products[..., 0, 3] = products[..., 3, 0] = m[..., 1, 0] - m[..., 0, 1]
    products[..., 1, 2] = products[..., 2, 1] = m[..., 1, 0] + m[..., 0, 1]
    products[..., 1, 3] = products[..., 3, 1] = m[..., 0, 2] + m[..., 2, 0]
    products[..., 2, 3] = products[..., 3, 2] = m[..., 2, 1] + m[..., 1, 2]
    largest = np.argmax(np.diagonal(products, axis1=-2, axis2=-1), axis=-1)
    q = np.take_along_axis(products, largest[..., None, None], axis=-2)[..., 0, :]
    return normalize(np.where(q[..., :1] < 0, -q, q))


def slerp(a: FloatArray, b: FloatArray, fraction: ArrayLike) -> FloatArray:
    """Turn from a (fraction 0) to b (fraction 1) at constant angular velocity along the shorter way.

    Args:
        a: unit quaternions, shape (..., 4).
        b: unit quaternions, shape (..., 4).
        fraction: broadcasts against the quaternions without their last axis.
    """
    fraction = np.asarray(fraction, dtype=float)[..., None]
    b = np.where(_sums(a * b) < 0, -b, b)
    # The angle from both norms keeps full precision where arccos of the product has lost half its digits.
    angle = 2 * np.arctan2(_lengths(a - b), _lengths(a + b))
    near = angle < 1e-6  # sin(angle) / angle is 1 to rounding
    sine = np.where(near, 1.0, np.sin(angle))
    weight_a = np.where(near, 1 - fraction, np.sin((1 - fraction) * angle) / sine)
    weight_b = np.where(near, fraction, np.sin(fraction * angle) / sine)
    return normalize(weight_a * a + weight_b * b)


def make_continuous(q: FloatArray) -> FloatArray:
    """Flip signs along the first axis (time) so that neighbours lie in one hemisphere; (F, ..., 4) to the same."""
    flips = np.sum(q[1:] * q[:-1], axis=-1) < 0
    if not flips.any():
        return q
    signs = np.ones(q.shape[:-1])
    signs[1:] = np.where(np.cumsum(flips, axis=0) % 2, -1.0, 1.0)
    return q * signs[..., None]


def _lengths(q: FloatArray) -> FloatArray:
    """Lengths of quaternions, shape (..., 1)."""
    return np.sqrt(_sums(q * q))


def _sums(q: FloatArray) -> FloatArray:
    """Sums along the last axis of four, shape (..., 1), far quicker than NumPy along so short an axis."""
    return (q[..., 0] + q[..., 1] + q[..., 2] + q[..., 3])[..., None]


def _parts(q: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """The four components, each (...)."""
    q = np.asarray(q)
    return q[..., 0], q[..., 1], q[..., 2], q[..., 3]
