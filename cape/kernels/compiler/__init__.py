"""From functions to machine code, by numba's front end and LLVM. Imported when something must be compiled.

The road of a function is `typing` (from Python to typed instructions), `lowering` (to LLVM's), `library` (to machine
code, with all that it calls); `kinds` tells numba what groups, functions and intrinsics are, `processor` and
`subnormals` what the machine is told, `internals` whether this is a numba that will do.
"""

from cape.kernels.compiler import internals

internals.require()
try:
    from cape.kernels.compiler.library import machine_code
except (ImportError, AttributeError) as error:
    raise internals.unfit(error) from error

__all__ = ["machine_code"]
