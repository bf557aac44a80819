"""Colours of constraints such that no two of one share a vertex: those can be solved in any order, or at once."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.cloth.coloring import Coloring, color

IntArray = NDArray[np.int64]

WORDS = 1  # of 64 colours each, that are tried first


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
    members = np.ascontiguousarray(members, dtype=np.int64)
    count, vertices, words = len(members), int(members.max()) + 1, WORDS
    while True:
        room = Coloring(
            order=np.zeros(count, np.int64),
            starts=np.zeros(64 * words + 1, np.int64),
            met=np.zeros((vertices, words), np.uint64),
            sorted=np.zeros_like(members),
            near=np.zeros(count, np.int64),
            begin=np.zeros(vertices + 1, np.int64),
            filled=np.zeros(vertices, np.int64),
            colors=np.zeros(count, np.int64),
        )
        colors = int(color(members, room))
        if colors > 0:
            return Colors(room.order, room.starts[: colors + 1].copy())
        words *= 2


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
