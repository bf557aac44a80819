"""Threads that share a cloth: which vertices are a rank's own, and how it waits until the others are as far.

All ranks of a team run the same program without the interpreter's lock, each on its own vertices, and meet between what
one writes and another reads. A team of one has all vertices, and nobody to wait for.

The barrier is the flag array of Mellor-Crummey and Scott, "Algorithms for scalable synchronization on shared-memory
multiprocessors" (ACM TOCS 9, 1991), section 3, in its flat form: each rank counts its meetings in a word of its own and
reads those of the others. Without any locked instruction a meeting of two costs what a cache line takes from core to
core; the number of lines read grows with the square of the ranks, which suits the few that a cloth can feed.
"""

import sys
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.jit import inlined, intrinsic, routine

BLOCK = 64  # vertices that a rank has one or several of, whole vectors and whole tiles of contact
LINE = 16  # words between two ranks' counts: 128 bytes, the pair of cache lines that a core fetches together
GONE = 2**62  # count of a rank that is done, or never came: nobody waits for it
SPINS = 200  # looks at a count, some 7 us, before the core is offered to other threads; more only helps where none wait
OFFERS = 20  # of the core, before the thread sleeps: others may take a whole slice of time, 3 ms, at each
NAP = 20  # us of sleep; who wakes is served before those who always work


class Team(NamedTuple):
    """One of the threads that share a cloth: its rank, how many there are, its vertices from `lo` to `hi`, and where
    they meet, a `LINE` of words for each rank."""

    rank: int
    size: int
    lo: int
    hi: int
    arrivals: NDArray[np.int64]

    @classmethod
    def alone(cls, vertices: int) -> "Team":
        """A single thread with so many vertices."""
        return cls(0, 1, 0, vertices, np.zeros(LINE, np.int64))


def span(n: int, rank: int, size: int) -> tuple[int, int]:
    """First of n vertices of a rank and the one after its last; whole blocks of 64, so that vector loops are whole.

    Ranks may have no vertices at all.
    """
    blocks = (n + BLOCK - 1) // BLOCK
    first, last = rank * blocks // size, (rank + 1) * blocks // size
    return min(first * BLOCK, n), min(last * BLOCK, n)


@inlined
def share(lo, hi, team):
    """What of lo to hi is this rank's; it may be nothing."""
    return lo + team.rank * (hi - lo) // team.size, lo + (team.rank + 1) * (hi - lo) // team.size


@routine
def meet(team):
    """Wait until every rank of the team has come here; what each wrote before is then seen by all.

    Call it from a routine alone, where all ranks pass by equally often: within a `kernel` arrays are promised to
    change by that kernel's own hand only, and LLVM would keep old values across the meeting.
    """
    if team.size == 1:
        return
    mine = team.rank * LINE
    count = team.arrivals[mine] + 1
    store_release(team.arrivals, mine, count)  # pyright: ignore[reportCallIssue]
    for rank in range(team.size):
        spins = 0
        while load_acquire(team.arrivals, rank * LINE) < count:
            spins += 1
            if spins < SPINS:
                pause()
            elif spins < SPINS + OFFERS:
                yield_core()
            else:
                sleep()


@intrinsic(lambda words, index: words[index])
def load_acquire(typingctx, words, index):
    """Read `words[index]`; nothing that follows happens before."""
    from numba import types

    def generate(context, builder, signature, arguments):
        return builder.load_atomic(_address(context, builder, signature, arguments), "acquire", align=8)

    return types.int64(words, types.int64), generate


@intrinsic(lambda words, index, value: words.__setitem__(index, value))
def store_release(typingctx, words, index, value):
    """Set `words[index]`; nothing that precedes happens after."""
    from numba import types

    def generate(context, builder, signature, arguments):
        address = _address(context, builder, signature, arguments)
        builder.store_atomic(arguments[2], address, "release", align=8)
        return context.get_dummy_value()

    return types.void(words, types.int64, types.int64), generate


@intrinsic(lambda: None)
def pause(typingctx):
    """Tell the core that this thread only waits, where it has an instruction for that."""
    from llvmlite import ir
    from numba import types

    def generate(context, builder, signature, arguments):
        machine = builder.module.triple.split("-")[0]
        if machine == "x86_64":
            _call(builder, "llvm.x86.sse2.pause", ir.VoidType())
        elif machine in ("aarch64", "arm64"):
            _call(builder, "llvm.aarch64.hint", ir.VoidType(), ir.Constant(ir.IntType(32), 1))
        return context.get_dummy_value()

    return types.void(), generate


@intrinsic(lambda: None)
def yield_core(typingctx):
    """Let another thread run on this core, by the system's `sched_yield` (POSIX.1-2017)."""
    from llvmlite import ir
    from numba import types

    def generate(context, builder, signature, arguments):
        if sys.platform != "win32":
            _call(builder, "sched_yield", ir.IntType(32))
        return context.get_dummy_value()

    return types.void(), generate


@intrinsic(lambda: None)
def sleep(typingctx):
    """Let this thread rest for a `NAP`, by the system's `usleep` (POSIX.1-2001)."""
    from llvmlite import ir
    from numba import types

    def generate(context, builder, signature, arguments):
        if sys.platform != "win32":
            _call(builder, "usleep", ir.IntType(32), ir.Constant(ir.IntType(32), NAP))
        return context.get_dummy_value()

    return types.void(), generate


def _address(context, builder, signature, arguments):
    """Where the word of a contiguous array is that the first two arguments name."""
    words = context.make_array(signature.args[0])(context, builder, arguments[0])
    return builder.gep(words.data, [arguments[1]])


def _call(builder, name, result, *arguments):
    from llvmlite import ir
    from numba.core import cgutils

    kind = ir.FunctionType(result, [argument.type for argument in arguments])
    builder.call(cgutils.get_or_insert_function(builder.module, kind, name), arguments)
