"""What machine code is written for: the processor at hand."""

import platform
from typing import Any

import llvmlite.binding as llvm
from numba.core import codegen


class Codegen(codegen.JITCPUCodegen):
    """Numba's, but without vector gathers.

    LLVM takes them for cheap. On AMD's Zen 4 they cost more than loads one by one: a mesh's springs in double precision
    27 instead of 19 ns for a vertex (`python -m tests.bench.mesh --double`).
    """

    def _customize_tm_features(self) -> str:
        features: Any = super()._customize_tm_features()
        return features + ",+prefer-no-gather" if platform.machine().lower() in {"x86_64", "amd64"} else features


def machine() -> llvm.TargetMachine:
    """What writes machine code."""
    return CODEGEN._tm


CODEGEN = Codegen("cape")
