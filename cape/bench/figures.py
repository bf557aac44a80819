"""Rows of figures as JSON objects."""

import math
from dataclasses import asdict
from typing import Any, ClassVar, Self


class Figures:
    """A dataclass of numbers and words; those of its fields that may be missing are not a number then.

    Attributes:
        digits: to which numbers are rounded for a JSON object.
    """

    digits: ClassVar[int] = 4

    def as_json(self) -> dict[str, Any]:
        """The figures for a JSON object, rounded; None for what is not a number."""
        return {name: _rounded(value, self.digits) for name, value in asdict(self).items()}  # pyright: ignore[reportArgumentType]

    @classmethod
    def from_json(cls, fields: dict[str, Any]) -> Self:
        """The figures that `as_json` gave; takes every None for not a number."""
        return cls(**{name: math.nan if value is None else value for name, value in fields.items()})


def _rounded(value: Any, digits: int) -> Any:
    if isinstance(value, float):
        return float(f"{value:.{digits}g}") if math.isfinite(value) else None
    return value
