"""From functions to machine code, by numba's front end and LLVM. Imported when something must be compiled.

The road of a function is `typing` (from Python to typed instructions), `lowering` (to LLVM's), `library` (to machine
code, with all that it calls); `kinds` tells numba what groups, functions and intrinsics are.
"""

from cape.kernels.compiler.library import machine_code

__all__ = ["machine_code"]
