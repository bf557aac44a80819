"""A wind that was measured, from a file."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from motions.border import checked
from motions.errors import FileError, ValueRangeError
from motions.files import printable, read_bytes
from motions.limits import LARGEST_NUMBER

FloatArray = NDArray[np.float64]

COLUMNS = ("time", "x", "y", "z")


@checked
@dataclass(frozen=True, eq=False)
class WindRecord:
    """Velocities of the air at times, straight in between, and as at the ends before and after.

    Attributes:
        times: rising [s], shape (n,).
        velocities: in the world [m/s], shape (n, 3).

    Raises:
        ValueRangeError: times do not rise, a number is not finite, or the shapes do not fit each other.
    """

    times: FloatArray
    velocities: FloatArray

    def __post_init__(self) -> None:
        """Copy and check the arrays."""
        times, velocities = np.array(self.times, dtype=float), np.array(self.velocities, dtype=float)
        if times.ndim != 1 or not len(times) or velocities.shape != (len(times), 3):
            raise ValueRangeError(
                "a record of the wind needs times of shape (n,) and velocities of shape (n, 3), "
                f"not {times.shape} and {velocities.shape}"
            )
        if not (np.isfinite(times).all() and np.isfinite(velocities).all() and (np.diff(times) > 0.0).all()):
            raise ValueRangeError("a record of the wind needs finite numbers, at times that rise")
        for name, array in (("times", times), ("velocities", velocities)):
            array.setflags(write=False)
            object.__setattr__(self, name, array)

    def at(self, time: float) -> FloatArray:
        """The velocity [m/s] at a time [s], shape (3,)."""
        return np.array([np.interp(time, self.times, component) for component in self.velocities.T])


@checked
def read_wind(path: str | Path) -> WindRecord:
    """Read a record of the wind: lines of time [s] and velocity x, y, z in the world [m/s], Z up, between commas.

    A first line "time,x,y,z" may name the columns; empty lines, and those that begin with #, are passed over.

    Raises:
        FileError: the file can't be read, or a line is not four numbers, or times do not rise.
    """
    path = Path(path)
    rows: list[list[float]] = []
    for number, line in enumerate(read_bytes(path).decode("utf-8-sig", "replace").splitlines(), 1):
        cells = [cell.strip() for cell in line.split(",")]
        if not line.strip() or line.lstrip().startswith("#"):
            continue
        if not rows and tuple(cell.lower() for cell in cells) == COLUMNS:
            continue
        try:
            row = [float(cell) for cell in cells]
        except ValueError:
            row = []
        if len(row) != len(COLUMNS) or not all(abs(value) <= LARGEST_NUMBER for value in row):
            told = printable(line)[:60]
            raise FileError(f"{path}, line {number}: expected {', '.join(COLUMNS)} as numbers, not {told!r}")
        if rows and row[0] <= rows[-1][0]:
            raise FileError(f"{path}, line {number}: times must rise, and {row[0]:g} s comes after {rows[-1][0]:g} s")
        rows.append(row)
    if not rows:
        raise FileError(f"{path}: there is no line of {', '.join(COLUMNS)}")
    table = np.array(rows)
    return WindRecord(table[:, 0], table[:, 1:])
