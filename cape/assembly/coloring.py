"""Colours of constraints such that no two of one share a vertex: those can be solved in any order, or at once."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.cloth.coloring import first_fit

IntArray = NDArray[np.int64]

WORD = 64  # colours


class Colors(NamedTuple):
    """An order of E constraints by colour, (E,), and where each of C colours starts in it, with its end, (C + 1,)."""

    order: IntArray
    starts: IntArray


def by_color(members: IntArray) -> Colors:
    """Order constraints on m vertices each, shape (E, m), by colour: greedy, in the order of their lowest vertices.

    Each gets the first colour that none of its vertices has met. A constraint that meets d others never needs more than
    d + 1 colours. Within a colour, constraints that are near in memory stay near.
    """
    if len(members) == 0:
        return Colors(np.zeros(0, dtype=np.int64), np.zeros(1, dtype=np.int64))
    near = _by_vertices(members)
    degree = np.bincount(members.ravel())
    most = int((degree[members] - 1).sum(axis=1).max()) + 1
    met = np.zeros((len(degree), -(-most // WORD)), dtype=np.uint64)
    colors = np.zeros(len(members), dtype=np.int64)
    first_fit(np.ascontiguousarray(members[near], dtype=np.int64), met, colors)
    starts = np.concatenate([[0], np.cumsum(np.bincount(colors))])
    return Colors(near[np.argsort(colors, kind="stable")], starts)


def _by_vertices(members: IntArray) -> IntArray:
    """The order of constraints (E, m) by their lowest vertices, then by their next ones, (E,)."""
    ordered = np.sort(members, axis=1)
    bits = max(int(ordered.max()).bit_length(), 1)
    together = 63 // bits  # vertices in one number
    keys = []
    for start in range(0, ordered.shape[1], together):
        key = np.zeros(len(ordered), np.int64)
        for column in ordered.T[start : start + together]:
            key = key << bits | column
        keys.append(key)
    # What is nearly in order already, as springs are, is soon sorted by a single key.
    return np.argsort(keys[0], kind="stable") if len(keys) == 1 else np.lexsort(keys[::-1])


class Blocks(NamedTuple):
    """Constraints by colour in blocks: which one is in each place, -1 for none, (B, lanes), and in which block each
    colour starts, with the end, (C + 1,)."""

    places: IntArray
    starts: IntArray


def in_blocks(colors: Colors, lanes: int) -> Blocks:
    """Fill every colour up to whole blocks of `lanes` constraints."""
    sizes = np.diff(colors.starts)
    starts = np.concatenate([[0], np.cumsum(-(-sizes // lanes))])
    places = np.full(lanes * starts[-1], -1)
    shift = np.repeat(lanes * starts[:-1] - colors.starts[:-1], sizes)
    places[np.arange(len(colors.order)) + shift] = colors.order
    return Blocks(places.reshape(-1, lanes), starts)
