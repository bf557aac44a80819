"""What a textile test found, and whether that is what it should be."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from cape.bench.figures import Figures
from cape.report.measured.stability import DEGRADES, FAILS, PASSES


@dataclass(frozen=True, kw_only=True)
class Row(Figures):
    """A figure of a test; those that there are not are not a number.

    Attributes:
        test: its name.
        subject: fabric, or what else was tested.
        direction: along which it was, "" where there is none.
        variant: the mesh, or the solver.
        quantity: what was measured.
        unit: of `simulated`, `scatter` and `expected`.
        simulated: what came out, the mean of all starts.
        scatter: standard deviation over the starts.
        starts: how many.
        expected: what should have.
        allowed: how far off it may be: in that unit, or as a share of what was expected.
        relative: whether `allowed` is a share.
        result: "finished", or why there is no figure or none that holds.
        source: where the expected figure comes from; why there is none.
    """

    digits: ClassVar[int] = 7  # enough for differences from what was expected
    test: str
    subject: str
    direction: str = ""
    variant: str
    quantity: str
    unit: str
    simulated: float
    scatter: float = math.nan
    starts: int = 1
    expected: float = math.nan
    allowed: float = math.nan
    relative: bool = False
    result: str = "finished"
    source: str

    @property
    def difference(self) -> float:
        """How far off it is, as `allowed` is given."""
        off = self.simulated - self.expected
        return off / self.expected if self.relative else off

    @property
    def verdict(self) -> str:
        """`PASSES`, `DEGRADES` where it is too far off, `FAILS` where it broke off; "" where nothing is expected."""
        if self.result != "finished":
            return FAILS
        if math.isnan(self.expected) or math.isnan(self.allowed):
            return ""
        return PASSES if abs(self.difference) <= self.allowed else DEGRADES


def mean(values: Sequence[float]) -> float:
    """Mean; not a number for no values."""
    return math.fsum(values) / len(values) if values else math.nan


def scatter(values: Sequence[float]) -> float:
    """Standard deviation; not a number for fewer than two values."""
    if len(values) < 2:
        return math.nan
    middle = mean(values)
    return math.sqrt(math.fsum((value - middle) ** 2 for value in values) / (len(values) - 1))
