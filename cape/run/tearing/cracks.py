"""Which edges part: tears go on from their tips, and where none can, the cloth gives way where it bears most.

As in O'Brien and Hodgins 1999 the cloth parts at vertices, across the direction in which they are drawn most, along the
edges next to that. Of vertices beside each other only the one that bears most parts: what is left of the load is
measured again before the next does.
"""

import math

import numpy as np
from numpy.typing import NDArray

from cape.run.tearing.loads import Loads
from cape.run.tearing.sheet import Edge, Sheet, Way

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

ROUNDS = 2  # edges that a tear goes on by at each of its tips until what is borne is measured again
STEEPEST = 0.8  # cosine of the angle of an edge to the direction of tension, above which a tear doesn't follow it


def parting(sheet: Sheet, loads: Loads) -> tuple[Sheet, IntArray]:
    """Part what bears too much: tips of tears, or else the worst of all vertices, and `ROUNDS` of what is next.

    Vertices that can't part, as what would part leads to what is held, are passed over.

    Returns:
        The sheet that is left, and the vertices of the one before that its new ones are copies of.
    """
    over = np.flatnonzero((loads.ratio > 1.0) & ~sheet.fixed)
    ratio: dict[int, float] = dict(zip(over.tolist(), loads.ratio[over].tolist(), strict=True))
    before, copies = sheet.vertices, np.zeros(0, np.int64)
    tips = over[sheet.torn[over]].tolist()
    edges = _edges_at_tips(sheet, tips, ratio, loads.along)
    if not edges:
        order = over[np.argsort(-loads.ratio[over], kind="stable")].tolist()
        edges = next((found for vertex in order if (found := edges_parting(sheet, vertex, loads.along[vertex]))), [])
    for _ in range(ROUNDS):
        if not edges:
            break
        sheet, more = sheet.split(edges)
        copies = np.concatenate([copies, [copies[v - before] if v >= before else v for v in more.tolist()]])
        ends = sorted({vertex for edge in edges for vertex in edge})
        edges = _edges_at_tips(sheet, [vertex for vertex in ends if vertex in ratio], ratio, loads.along)
    return sheet, copies.astype(np.int64)


def _edges_at_tips(sheet: Sheet, tips: list[int], ratio: dict[int, float], along: FloatArray) -> list[Edge]:
    """The edges that part at the tips of tears, of those beside each other at the one that bears most."""
    return [
        edge for vertex in tips if _is_worst(sheet, vertex, ratio, tips)
        for edge in edges_parting(sheet, vertex, along[vertex])
    ]  # fmt: skip


def _is_worst(sheet: Sheet, vertex: int, ratio: dict[int, float], tips: list[int]) -> bool:
    """Whether a tip bears more than all others that share a cell with it, of equals the first."""
    near = {other for cell in sheet.around[vertex] for other in sheet.cells[cell].tolist()}
    return all((-ratio[vertex], vertex) <= (-ratio[other], other) for other in tips if other in near)


def edges_parting(sheet: Sheet, vertex: int, along: FloatArray) -> list[Edge]:
    """The edges that part at a vertex drawn along a direction (2,): one to either side, or one from a border inwards.

    None where cells are on one side only, or where an edge would lead to a vertex that never splits: cells beyond it
    would hang by that.
    """
    u, v = along.tolist()
    inner: list[tuple[float, int, Way]] = []
    edges = [(other, sides) for other, sides in sheet.edges_at(vertex).items() if len(sides) == 2]
    for other, sides in edges:
        x, y = (sum(parts) for parts in zip(*(way for _, way in sides), strict=True))
        length = math.hypot(x, y)
        slope = abs(u * x + v * y) / length if length > 0.0 else 1.0
        if slope <= STEEPEST and not sheet.fixed[other]:
            inner.append((round(slope, 9), other, (x, y)))
    inner.sort()
    chosen = [other for _, other, _ in inner[:1]]
    if inner and len(edges) == len(
        sheet.around[vertex]
    ):  # all around: nothing parts without a second edge, on the other side
        x, y = inner[0][2]
        back = [other for _, other, (w, z) in inner[1:] if x * w + y * z < 0.0]
        chosen = chosen + back[:1] if back else []
    return [(min(vertex, other), max(vertex, other)) for other in chosen]
