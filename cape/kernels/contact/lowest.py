"""The lowest point of some planes over a triangle, where they are the highest.

A linear programme in the barycentric weights u and v (the third is 1 - u - v) and a height t: the least t with
p u + q v + r <= s t for all rows (p, q, s, r). Planes are rows with s = 1, the triangle's edges those with s = 0. Three
rows hold a solution. Another that it does not keep comes in for one of them by the dual simplex method (Lemke 1954,
"The dual method of solving the linear programming problem"); a row that holds nothing is forgotten, which leaves the
solution a bound from below.
"""

import math

from cape.kernels.jit import inlined

NO_U, NO_V, NO_W = (-1.0, 0.0, 0.0, 0.0), (0.0, -1.0, 0.0, 0.0), (1.0, 1.0, 0.0, -1.0)
OUTSIDE = 1e-9  # that a weight must be below zero for its edge to come in
ENTRIES = 4  # of edges, after a plane


@inlined
def row_of(a, b, c):
    """The row of a plane with heights a, b, c [m] at the corners."""
    return a - c, b - c, 1.0, c


@inlined
def cross(a, b):
    """Cross product of the first three numbers of two rows."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


@inlined
def dot(a, row):
    """Scalar product with the first three numbers of a row."""
    return a[0] * row[0] + a[1] * row[1] + a[2] * row[2]


@inlined
def lowest_of_one(a, b, c):
    """The rows that hold a single plane, with heights a, b, c [m] at the corners, and its lowest point (u, v, t)."""
    plane = row_of(a, b, c)
    if a < b and a < c:
        return (plane, NO_V, NO_W), (1.0, 0.0, a)
    if b < c:
        return (plane, NO_W, NO_U), (0.0, 1.0, b)
    return (plane, NO_U, NO_V), (0.0, 0.0, c)


@inlined
def with_row(rows, row):
    """Rows with one more that their solution does not keep, without the one that holds it least then."""
    first, second, third = rows
    h, i, j = cross(second, third), cross(third, first), cross(first, second)
    x, y, z = dot(h, row), dot(i, row), dot(j, row)
    leaves, pull, held = 0, 0.0, 1.0
    if x > 0.0:
        leaves, pull, held = 1, x, h[2]
    if y > 0.0 and i[2] * pull < held * y:
        leaves, pull, held = 2, y, i[2]
    if z > 0.0 and j[2] * pull < held * z:
        leaves = 3
    if leaves == 1:
        first = row
    elif leaves == 2:
        second = row
    elif leaves == 3:
        third = row
    return first, second, third


@inlined
def solution(rows):
    """Where three rows meet, (u, v, t); t is minus infinity where they are as good as parallel."""
    first, second, third = rows
    h, i, j = cross(second, third), cross(third, first), cross(first, second)
    size = dot(h, first)
    if size <= 0.0:
        return 0.0, 0.0, -math.inf
    scale = -1.0 / size
    u = scale * (first[3] * h[0] + second[3] * i[0] + third[3] * j[0])
    v = scale * (first[3] * h[1] + second[3] * i[1] + third[3] * j[1])
    return u, v, -scale * (first[3] * h[2] + second[3] * i[2] + third[3] * j[2])


@inlined
def entered(rows, a, b, c):
    """Rows that a plane with heights a, b, c [m] at the corners came into; it is above the lowest point so far."""
    return with_row(rows, row_of(a, b, c))


@inlined
def lowest_of(rows):
    """The rows that hold the lowest point within the triangle, and that point, (u, v, t)."""
    u, v, t = solution(rows)
    for _ in range(ENTRIES):
        w = 1.0 - u - v
        if min(u, min(v, w)) >= -OUTSIDE:
            break
        if u <= v and u <= w:
            rows = with_row(rows, NO_U)
        elif v <= w:
            rows = with_row(rows, NO_V)
        else:
            rows = with_row(rows, NO_W)
        u, v, t = solution(rows)
    u, v = min(max(u, 0.0), 1.0), max(v, 0.0)
    return rows, (u, min(v, 1.0 - u), t)
