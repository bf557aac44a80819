"""Greedy colouring."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.jit import inlined, routine

Indices = NDArray[np.int64]


class Coloring(NamedTuple):
    """Room to colour E constraints on m of V vertices each.

    What comes out: `order` (E,), of the constraints by their colours, and where each colour `starts` in it (64 W + 1,).
    `met` (V, W) has a bit for each colour that a vertex has met; enough words W for all colours. And scratch: the
    vertices of each constraint, the lowest first, `sorted` (E, m); the constraints by these, `near` (E,), where those
    of each lowest vertex begin, `begin` (V + 1,), and how many are there, `filled` (V,); the `colors` of those (E,).
    """

    order: Indices
    starts: Indices
    met: NDArray[np.uint64]
    sorted: Indices
    near: Indices
    begin: Indices
    filled: Indices
    colors: Indices


@routine
def color(members, room):
    """Give each of the constraints (E, m), by their lowest vertices, then by their next ones, the first colour that
    none of its vertices has met.

    Returns how many colours there are; -1 where there is no room for them.
    """
    sort_by_vertices(members, room)
    count = first_fit(members, room)
    for k in range(count + 1):
        room.starts[k] = 0
    if count > 0:
        for k in range(members.shape[0]):
            room.starts[room.colors[k] + 1] += 1
        for k in range(count):
            room.starts[k + 1] += room.starts[k]
        # Each stands where its colour starts, which is moved on, and then back.
        for k in range(members.shape[0]):
            colour = room.colors[k]
            room.order[room.starts[colour]] = room.near[k]
            room.starts[colour] += 1
        for k in range(count, 0, -1):
            room.starts[k] = room.starts[k - 1]
        room.starts[0] = 0
    return count


@routine
def sort_by_vertices(members, room):
    """Order constraints by their lowest vertices, then by their next ones; alike ones stay as they are."""
    rows, begin, near = room.sorted, room.begin, room.near
    begin[:] = 0
    room.filled[:] = 0
    for k in range(members.shape[0]):
        for a in range(members.shape[1]):
            value, place = members[k, a], a
            while place > 0 and rows[k, place - 1] > value:
                rows[k, place] = rows[k, place - 1]
                place -= 1
            rows[k, place] = value
        begin[rows[k, 0] + 1] += 1
    for i in range(begin.size - 1):
        begin[i + 1] += begin[i]
    for k in range(members.shape[0]):
        # Among those with the same lowest vertex, which are few.
        first = begin[rows[k, 0]]
        place = first + room.filled[rows[k, 0]]
        room.filled[rows[k, 0]] += 1
        while place > first and is_before(rows, k, near[place - 1]):
            near[place] = near[place - 1]
            place -= 1
        near[place] = k


@inlined
def is_before(rows, one, other):
    """Tell whether a row of numbers comes before another one."""
    for a in range(rows.shape[1]):
        if rows[one, a] != rows[other, a]:
            return rows[one, a] < rows[other, a]
    return False


@routine
def first_fit(members, room):
    """Colour constraints in the order of `Coloring.near`; returns how many colours there are, or -1."""
    one, full, count, met = np.uint64(1), ~np.uint64(0), 0, room.met
    met[:] = np.uint64(0)
    for k in range(members.shape[0]):
        row, word, taken = room.near[k], 0, full
        while taken == full:
            if word == met.shape[1]:
                return -1
            taken = np.uint64(0)
            for a in range(members.shape[1]):
                taken |= met[members[row, a], word]
            word += 1
        colour = 0
        while (taken >> np.uint64(colour)) & one:
            colour += 1
        for a in range(members.shape[1]):
            met[members[row, a], word - 1] |= one << np.uint64(colour)
        room.colors[k] = 64 * (word - 1) + colour
        count = max(count, room.colors[k] + 1)
    return count
