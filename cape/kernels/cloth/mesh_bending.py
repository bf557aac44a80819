"""Forces that are a constant matrix times the positions, as bending is on a mesh: row after row of the matrix.

The matrix is symmetric and its rows are zero in sum, so that the force on vertex i is the sum over others j of
weight_ij (q_j - q_i), which loses no digits to how far from the origin a cloth is. Every row has all its entries,
about 36 others, though each is there twice: to fetch three coordinates that lie side by side costs less than to keep
and collect what half of the links give to their other ends.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.absent import typed
from cape.kernels.jit import inlined, intrinsic, kernel, unit
from cape.kernels.state import State
from cape.kernels.team import meet

Array = NDArray[np.floating]

SIDE = 4  # numbers from one vertex to the next in `packed`, a power of two
ONE = np.uint64(1)
SUMS = 4  # sums that a row is added to by turns, a power of two


class MeshBends(NamedTuple):
    """Rows of the matrix: `others` and `weight` [N/m] of vertex i stand from `start[i]` on; `start` (N + 1,).

    Others are told by their places in `packed`, SIDE times their numbers, which spares a shift in the innermost loop.
    Rows have a multiple of SUMS of them, filled up with the vertex itself, so that as many sums are made at once.
    `packed` (4 N,) is room for what the matrix is multiplied with.
    """

    start: NDArray[np.int64]
    others: NDArray[np.uint32]
    weight: Array
    packed: Array


class MeshBendForces(NamedTuple):
    """Bending of a mesh, which adds to `forces` (3, N) [N]; `damping` is its damping time [s], None for none."""

    state: State
    bends: MeshBends
    damping: float | None
    forces: Array


@unit
def mesh_bends(g, team, substep, substeps, step):
    """Add the forces of bending to the forces on a thread's vertices."""
    s, b, f, lo, hi = g.state, g.bends, g.forces, team.lo, team.hi
    pack_moved(lo, hi, s.x, s.y, s.z, s.vx, s.vy, s.vz, typed(g.damping, s.x), b.packed)
    meet(team)
    add_rows(lo, hi, s.x.dtype.type(1.0), b.start, b.others, b.weight, b.packed, f[0], f[1], f[2])


@kernel
def pack_moved(lo, hi, x, y, z, vx, vy, vz, time, packed):
    """Write positions [m] as they are after `time` [s], unless that is None, of vertices lo to hi side by side."""
    for i in range(lo, hi):
        if time is None:
            put(packed, i, x[i], y[i], z[i])
        else:
            put(packed, i, x[i] + time * vx[i], y[i] + time * vy[i], z[i] + time * vz[i])


@kernel
def pack_vectors(lo, hi, x, y, z, packed):
    """Write three coordinates of vertices lo to hi side by side."""
    for i in range(lo, hi):
        put(packed, i, x[i], y[i], z[i])


@inlined
def put(packed, i, x, y, z):
    """Write three coordinates of vertex i side by side."""
    at = np.uint64(SIDE * i)
    packed[at], packed[at + np.uint64(1)], packed[at + np.uint64(2)] = x, y, z


@kernel
def add_rows(lo, hi, scale, start, others, weight, packed, fx, fy, fz):
    """Add `scale` times the sums of weight (q_j - q_i) over the others of vertices lo to hi, q being what is packed."""
    end = start[lo]
    for i in range(np.uint64(lo), np.uint64(hi)):
        begin, end = end, start[i + ONE]
        x, y, z = row_sum(others, weight, packed, begin, end, np.int64(SIDE * i))
        fx[i] += scale * x
        fy[i] += scale * y
        fz[i] += scale * z


def _row_sum(others, weight, packed, start, end, own):
    """What `row_sum` does, in numpy."""
    q = packed.reshape(-1, SIDE)
    pulls = weight[start:end, None] * (q[others[start:end] // SIDE] - q[own // SIDE])
    total = pulls.sum(axis=0)
    return total[0], total[1], total[2]


@intrinsic(_row_sum)
def row_sum(typingctx, others, weight, packed, start, end, own):
    """Sum of weight (q_j - q_own) over the others of a row, by turns in SUMS sums that do not wait for each other.

    The coordinates of a vertex are one vector of `SIDE` numbers: LLVM itself takes them one by one, which makes twice
    as many instructions.
    """
    from llvmlite import ir
    from numba import types
    from numba.core import cgutils

    def generate(context, builder, signature, arguments):
        number = context.get_value_type(signature.args[1].dtype)
        vector, word = ir.VectorType(number, SIDE), ir.IntType(64)
        rows, weights, points = (
            context.make_array(kind)(context, builder, value).data
            for kind, value in zip(signature.args[:3], arguments[:3], strict=True)
        )
        first, last, mine = arguments[3:]

        def point(index):
            place = builder.gep(points, [index])
            return builder.load(builder.bitcast(place, vector.as_pointer()), align=4)

        def pull(total, index, origin):
            other = builder.zext(builder.load(builder.gep(rows, [index])), word)
            one = builder.load(builder.gep(weights, [index]))
            lane = builder.insert_element(ir.Constant(vector, ir.Undefined), one, ir.IntType(32)(0))
            every = ir.Constant(ir.VectorType(ir.IntType(32), SIDE), [0] * SIDE)
            spread = builder.shuffle_vector(lane, ir.Constant(vector, ir.Undefined), every)
            return builder.call(multiply_add, [spread, builder.fsub(point(other), origin), total])

        name = f"llvm.fmuladd.v{SIDE}{number.intrinsic_name}"
        multiply_add = cgutils.get_or_insert_function(builder.module, ir.FunctionType(vector, (vector,) * 3), name)
        origin, before = point(mine), builder.block
        head, body, after = (builder.append_basic_block(name) for name in ("row", "pair", "sums"))
        builder.branch(head)
        builder.position_at_end(head)
        index = builder.phi(word)
        sums = [builder.phi(vector) for _ in range(SUMS)]
        builder.cbranch(builder.icmp_signed("<", index, last), body, after)
        builder.position_at_end(body)
        added = [pull(sums[k], builder.add(index, word(k)), origin) for k in range(SUMS)]
        following = builder.add(index, word(SUMS))
        builder.branch(head)
        index.add_incoming(first, before)
        index.add_incoming(following, body)
        for total, one in zip(sums, added, strict=True):
            total.add_incoming(ir.Constant(vector, [0.0] * SIDE), before)
            total.add_incoming(one, body)
        builder.position_at_end(after)
        while len(sums) > 1:
            sums = [builder.fadd(one, other) for one, other in zip(sums[::2], sums[1::2], strict=True)]
        total = sums[0]
        parts = [builder.extract_element(total, ir.IntType(32)(k)) for k in range(3)]
        return context.make_tuple(builder, signature.return_type, parts)

    arguments = (others, weight, packed, types.int64, types.int64, types.int64)
    return types.UniTuple(weight.dtype, 3)(*arguments), generate
