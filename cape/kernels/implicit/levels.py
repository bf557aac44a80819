"""The levels of a multigrid preconditioner, and the matrix of each; see `multigrid` for what is done with them.

A level's matrix is that of nodes joined by links, each with a symmetric block B: (A z)_i = O_i z_i + sum_j B_ij (z_i -
z_j). P^T A P with smooth weights P would join each node with two dozen others. Instead a link's block is the sum of
those of the finer links that cross between two aggregates, each times its share of the distance between these. That is
P^T A P for indicators as P, but for the factor, which makes up for their steps: m springs in a row between two nodes
are m times as soft as one of them (by algebra). O is the sum of masses and contact. Bending is left out, as it shrinks
with the fourth power of the distance between nodes.

Blocks are stored as the rows xx, yy, zz, xy, xz, yz, as in `stiffness`. Loops run over all nodes for one neighbour
after the other, so that arithmetic vectorises.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.implicit.stiffness import Matrix, copy, damped
from cape.kernels.jit import kernel, routine, unit
from cape.kernels.team import share

Array = NDArray[np.floating]
Numbers = NDArray[np.uint32]
Indices = NDArray[np.int64]


class Lists(NamedTuple):
    """For each of several items a list: those from `start[k]` to `start[k + 1]` of `members` with `weights`.

    Of a mesh's vertices `members` are places in what is packed, a multiple of SUMS of them: see `MeshBends`.
    """

    start: Indices
    members: Numbers
    weights: Array


class Level(NamedTuple):
    """The N nodes of a level and the E links between them; n are the nodes of the finer one, or the vertices.

    `moving` lists for each node the finer ones that it moves, and `nodes` (3, n) with `weights` (3, n) those that move
    each finer one. `gathered` lists the finer nodes of which each is made; `crossing` the places of the finer links
    that make up each link, and `held` of those from each node to what is held. `neighbours` (D, N) and the `links` (D,
    N) to them, itself and link E where there are less. `blocks` (6, E + 1) of the links, the last of them 0, and the
    same as `beside` (D, 6, N) of each node's; `own`, `diagonal` and its inverse (6, N) [N/m]. `residual`, `moved`,
    `left` and `result` (3, N) are vectors.
    """

    moving: Lists
    nodes: Numbers
    weights: Array
    gathered: Lists
    crossing: Lists
    held: Lists
    neighbours: Numbers
    links: Numbers
    blocks: Array
    beside: Array
    own: Array
    diagonal: Array
    inverse: Array
    residual: Array
    moved: Array
    left: Array
    result: Array


class Between(NamedTuple):
    """Rows, or columns, of a grid: each moves with a block `first` by a `weight`, with `second` by the rest, (R,)."""

    first: Indices
    second: Indices
    weight: Array


class Interpolation(NamedTuple):
    """A grid's vertices between blocks, `width` of them side by side. The rows from `begin` to `end` move with each row
    of blocks; `room` (ranks, 6, columns) is scratch."""

    rows: Between
    columns: Between
    begin: Indices
    end: Indices
    width: int
    room: Array


class FirstLevel(NamedTuple):
    """A level above the vertices of a cloth. A link's w and c are at its place in `coefficients` and `stride`, 2 and 3
    times `stride` further; `terms` (L,) is room for those of the dot product of r and z. `between` is None for a mesh.
    `packed` (4 N + 4,) is room for the residual of a mesh's vertices side by side, and a point that stays 0.
    """

    matrix: Matrix
    level: Level
    coefficients: Array
    stride: int
    terms: Array
    between: Interpolation | None
    packed: Array


class Above(NamedTuple):
    """A level and the finer one."""

    finer: Level
    level: Level


@unit
def gather_links(g, team, substep, substeps, b):
    """Set the blocks of the first level's links from those of the links between vertices."""
    level, crossing = g.level, g.level.crossing
    lo, hi = share(0, level.blocks.shape[1] - 1, team)
    sum_links(
        lo, hi, g.stride, g.coefficients, crossing.start, crossing.members, crossing.weights, level.blocks
    )  # fmt: skip


@unit
def gather_vertices(g, team, substep, substeps, b):
    """Set the diagonal of the first level."""
    level, m = g.level, g.matrix
    gathered, held = level.gathered, level.held
    lo, hi = share(0, level.own.shape[1], team)
    bend = level.blocks.dtype.type(damped(m.bend_damping, b))
    sum_links(
        lo, hi, g.stride, g.coefficients, held.start, held.members, held.weights, level.own
    )  # fmt: skip
    add_own(lo, hi, m.front, bend, m.bend_diagonal, m.own, gathered.start, gathered.members, level.own)
    finish_matrix(lo, hi, level)


@unit
def gather_level(g, team, substep, substeps, b):
    """Set the matrix of a level from that of the finer one, for one thread."""
    level, finer, crossing, gathered = g.level, g.finer, g.level.crossing, g.level.gathered
    links, nodes = level.blocks.shape[1] - 1, level.own.shape[1]
    sum_lists(links, finer.blocks, crossing.start, crossing.members, crossing.weights, level.blocks)
    sum_lists(nodes, finer.own, gathered.start, gathered.members, gathered.weights, level.own)
    finish_matrix(0, nodes, level)


@routine
def finish_matrix(lo, hi, level):
    """Lay out the blocks beside nodes lo to hi, and set the diagonal: a node's own block and those of all its links."""
    d, n = level.diagonal, level.inverse
    for row in range(6):
        copy(level.own[row, lo:hi], d[row, lo:hi])
    for k in range(level.links.shape[0]):
        links = level.links[k, lo:hi]
        for row in range(6):
            fetch(links, level.blocks[row], level.beside[k, row, lo:hi], d[row, lo:hi])
    for row in range(6):
        copy(d[row, lo:hi], n[row, lo:hi])
    invert(n[0, lo:hi], n[1, lo:hi], n[2, lo:hi], n[3, lo:hi], n[4, lo:hi], n[5, lo:hi])


@kernel
def sum_links(lo, hi, stride, coefficients, start, places, scales, blocks):
    """Set blocks lo to hi to the sums of w w' + c over lists of links, each times its scale."""
    zero = blocks.dtype.type(0)
    for item in range(lo, hi):
        xx = yy = zz = xy = xz = yz = zero
        for k in range(start[item], start[item + 1]):
            place, scale = np.int64(places[k]), scales[k]
            x, y, z = coefficients[place], coefficients[place + stride], coefficients[place + 2 * stride]
            c = coefficients[place + 3 * stride]
            xx += scale * (x * x + c)
            yy += scale * (y * y + c)
            zz += scale * (z * z + c)
            xy += scale * (x * y)
            xz += scale * (x * z)
            yz += scale * (y * z)
        blocks[0, item], blocks[1, item], blocks[2, item] = xx, yy, zz
        blocks[3, item], blocks[4, item], blocks[5, item] = xy, xz, yz


@kernel
def add_own(lo, hi, front, bend, bend_diagonal, own, start, members, out):
    """Add to the own blocks of nodes those of their vertices without bending."""
    for node in range(lo, hi):
        xx, yy, zz, xy, xz, yz = out[0, node], out[1, node], out[2, node], out[3, node], out[4, node], out[5, node]
        for k in range(start[node], start[node + 1]):
            i = front + np.int64(members[k])
            bends = bend * bend_diagonal[i]
            xx += own[0, i] - bends
            yy += own[1, i] - bends
            zz += own[2, i] - bends
            xy += own[3, i]
            xz += own[4, i]
            yz += own[5, i]
        out[0, node], out[1, node], out[2, node] = xx, yy, zz
        out[3, node], out[4, node], out[5, node] = xy, xz, yz


@kernel
def sum_lists(items, finer, start, members, weights, out):
    """Set columns to the sums over lists of finer ones, each times its weight."""
    for row in range(out.shape[0]):
        for item in range(items):
            total = out.dtype.type(0)
            for k in range(start[item], start[item + 1]):
                total += weights[k] * finer[row, members[k]]
            out[row, item] = total


@kernel
def fetch(places, values, out, total):
    """Copy values from places, and add them up."""
    for i in range(out.size):
        value = values[places[i]]
        out[i] = value
        total[i] += value


@kernel
def invert(xx, yy, zz, xy, xz, yz):
    """Replace each block by its inverse, by 0 if it is 0: a node that is made of held vertices alone."""
    one, zero = xx.dtype.type(1), xx.dtype.type(0)
    for i in range(xx.size):
        a, b, c, d, e, f = xx[i], yy[i], zz[i], xy[i], xz[i], yz[i]
        minor_x, minor_y, minor_z = b * c - f * f, e * f - d * c, d * f - b * e
        determinant = a * minor_x + d * minor_y + e * minor_z
        scale = one / determinant if a > zero else zero
        xx[i] = scale * minor_x
        xy[i] = scale * minor_y
        xz[i] = scale * minor_z
        yy[i] = scale * (a * c - e * e)
        yz[i] = scale * (d * e - a * f)
        zz[i] = scale * (a * b - d * d)
