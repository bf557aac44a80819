"""What a solver's cost is compared with: a scalar loop over the same springs, and their arithmetic on contiguous data.

Both take steps of no length, so that the numbers stay as they are however often they are worked through.
"""

from typing import Any

import numpy as np

from cape.bench.subject import Subject
from cape.bench.timing import Probe
from cape.kernels.calling import Bound
from cape.kernels.cloth.baselines import limit_step, scalar_step
from cape.kernels.jit import Function

UNITS = 1e5  # vertices times steps in a call
ROWS, STRANGERS = 4, 256  # of the limit, and vertices of each, in the first cache
APART = 0.01  # m, between those rows


class Loop(Probe):
    """A loop over the springs of a subject's cloth, in its precision, with what its fabric has; no contact, no air."""

    def __init__(self, subject: Subject) -> None:
        """Copy the springs in the loop's precision."""
        assembly, dtype = subject.assembly, subject.state.x.dtype.type
        springs, fabric = assembly.springs, assembly.cloth.fabric
        self.layout, self.precision, self.vertices = subject.layout, subject.precision, assembly.cloth.vertices
        self._substeps = max(1, int(UNITS / self.vertices))
        self.units = float(self._substeps * self.vertices)
        self._dtype, self._springs, self._state = dtype, springs, np.stack(subject.state)
        self._weights = (dtype(0), assembly.inverse_mass.astype(dtype))
        self._stiffness = springs.stiffness.astype(dtype), springs.rest.astype(dtype)
        self._damping = dtype(fabric.damping_time) if fabric.damping_time else None
        self._coefficients = self._bend_stiffness = self._bend_damping = None
        if len(springs.bend_stiffness):
            self._coefficients = springs.bend_coefficients.astype(dtype)
            self._bend_stiffness = springs.bend_stiffness.astype(dtype)
            self._bend_damping = dtype(fabric.bend_damping_time) if fabric.bend_damping_time else None

    def _bind(self, loop: Function, *arguments: Any) -> None:
        """Take the loop, and its arguments after the number of substeps."""
        self._call = Bound(loop, self._substeps, *arguments)
        self.requests = [self._call.request]

    def call(self) -> None:
        """Take substeps."""
        self._call()

    def prepare(self) -> None:
        """Nothing: no time passes."""

    def rewind(self) -> None:
        """Nothing: no time passes."""


class Scalar(Loop):
    """One spring after the other."""

    def __init__(self, subject: Subject) -> None:
        """Add the ends of the springs."""
        super().__init__(subject)
        bent = None if self._coefficients is None else self._springs.bend_vertices
        self._bind(
            scalar_step, *self._weights, self._springs.first, self._springs.second, *self._stiffness, self._damping,
            bent, self._coefficients, self._bend_stiffness, self._bend_damping,
            *np.zeros((3, self.vertices), self._dtype), *self._state,
        )  # fmt: skip


class Limit(Loop):
    """The same arithmetic without any index."""

    def __init__(self, subject: Subject) -> None:
        """Add rows of vertices that stand in for the ends of springs."""
        super().__init__(subject)
        strangers = np.stack([self._state[:, :STRANGERS]] * ROWS)
        strangers[1:] += self._dtype(APART)
        coefficients, stiffness = self._coefficients, self._bend_stiffness
        if coefficients is not None and stiffness is not None:
            # One on more than four vertices has the arithmetic of several.
            four = np.pad(coefficients, ((0, 0), (0, -coefficients.shape[1] % 4)))
            stiffness = np.repeat(stiffness, four.shape[1] // 4)
            coefficients = np.ascontiguousarray(four.reshape(-1, 4).T)
        self._bind(
            limit_step, *self._weights, *self._stiffness, self._damping, coefficients, stiffness,
            self._bend_damping, np.zeros((ROWS, 3, strangers.shape[2]), self._dtype), strangers,
        )  # fmt: skip
