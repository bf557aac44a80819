"""Numbers too small to matter, which some processors take a hundred times as long for as for any other.

Below 1.2e-38 in single precision, and 2.2e-308 in double, numbers lose their digits one by one: they are subnormal
(IEEE 754-2019, section 3.4). Intel's processors reckon with them in microcode. Cloth that hardly moves is full of them:
in single precision a step of the mesh of `python -m tests.bench.against` took 63 ns for a vertex instead of 31. Within
compiled code they count as zero, on every thread, and the processor is then left as it was.
"""

from llvmlite import ir
from numba.core import cgutils, types

from cape.kernels.jit import intrinsic

COUNT_AS_ZERO = 1 << 15 | 1 << 6
"""Bits of the register MXCSR: results and operands that are subnormal are zero (Intel, "Intel 64 and IA-32
Architectures Software Developer's Manual", volume 1, sections 10.2.3.3 and 10.2.3.4)."""


@intrinsic(lambda: 0)
def count_subnormals_as_zero(typingctx):
    """Do so on this thread, where its processor is one that minds them; returns what to give to `restore`."""

    def generate(context, builder, signature, arguments):
        word = ir.IntType(32)
        if not _minds(builder):
            return word(0)
        place = _room(builder)
        _call(builder, "stmxcsr", place)
        before = builder.load(place)
        builder.store(builder.or_(before, word(COUNT_AS_ZERO)), place)
        _call(builder, "ldmxcsr", place)
        return before

    return types.int32(), generate


@intrinsic(lambda before: None)
def restore(typingctx, before):
    """Leave this thread as it was before."""

    def generate(context, builder, signature, arguments):
        if _minds(builder):
            place = _room(builder)
            builder.store(arguments[0], place)
            _call(builder, "ldmxcsr", place)
        return context.get_dummy_value()

    return types.void(types.int32), generate


def _minds(builder):
    return builder.module.triple.split("-")[0] == "x86_64"


def _room(builder):
    return cgutils.alloca_once(builder, ir.IntType(32))


def _call(builder, name, place):
    pointer = ir.IntType(8).as_pointer()
    kind = ir.FunctionType(ir.VoidType(), [pointer])
    function = builder.module.declare_intrinsic(f"llvm.x86.sse.{name}", (), kind)
    builder.call(function, [builder.bitcast(place, pointer)])
