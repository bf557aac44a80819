"""A product and a sum in one instruction, which LLVM may not make of `a * b + c` by itself: see `kernels.jit`."""

from cape.kernels.jit import intrinsic


@intrinsic(lambda a, b, c: a * b + c)
def fused(typingctx, a, b, c):
    """Tell a b + c, rounded once where the processor can, in every loop of that machine alike."""
    from llvmlite import ir
    from numba.core import errors

    if not a == b == c:
        raise errors.TypingError(f"a b + c of one precision, not of {a}, {b} and {c}")

    def generate(context, builder, signature, arguments):
        kind = arguments[0].type
        function = builder.module.declare_intrinsic("llvm.fmuladd", (kind,), ir.FunctionType(kind, (kind,) * 3))
        return builder.call(function, arguments)

    return a(a, b, c), generate
