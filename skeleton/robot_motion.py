"""A robot's motion: its configurations over time."""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from motions.border import checked
from motions.errors import ValueRangeError

FloatArray = NDArray[np.float64]


@checked
@dataclass(frozen=True, eq=False)
class RobotMotion:
    """Configurations of a robot over F frames. Arrays are copied, checked and made read-only.

    Attributes:
        name: what the motion is called.
        configurations: in Pinocchio's order, metres, radians and quaternions (x, y, z, w), shape (F, nq).
        times: times of the frames [s], increasing, shape (F,).
        decisions: what had to be decided or looks doubtful, a sentence each.

    Raises:
        ValueRangeError: shapes that don't fit, numbers that aren't finite, times that don't increase.
    """

    name: str
    configurations: FloatArray
    times: FloatArray
    decisions: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        """Copy, check and freeze the arrays."""
        configurations = np.array(self.configurations, dtype=float)
        times = np.array(self.times, dtype=float)
        if configurations.ndim != 2 or not configurations.size:
            raise ValueRangeError(
                f"motion {self.name!r}: configurations have the shape (frames, nq), got {configurations.shape}"
            )
        if times.shape != (len(configurations),):
            raise ValueRangeError(
                f"motion {self.name!r}: times have the shape {(len(configurations),)}, got {times.shape}"
            )
        for label, array in (("configuration", configurations), ("time", times[:, None])):
            if (bad := ~np.isfinite(array).all(axis=1)).any():
                raise ValueRangeError(f"motion {self.name!r}: the {label} of frame {np.argmax(bad)} isn't finite")
        if (stalled := np.diff(times) <= 0.0).any():
            raise ValueRangeError(
                f"motion {self.name!r}: times must increase, frame {np.argmax(stalled) + 1} isn't after the one before"
            )
        for label, array in (("configurations", configurations), ("times", times)):
            array.setflags(write=False)
            object.__setattr__(self, label, array)

    @property
    def frames(self) -> int:
        """Number of frames F."""
        return len(self.times)

    @property
    def duration(self) -> float:
        """Time from the first frame to the last [s]."""
        return float(self.times[-1] - self.times[0])

    @property
    def fps(self) -> float:
        """Mean number of frames per second.

        Raises:
            ValueRangeError: the motion has a single frame.
        """
        if self.frames < 2:
            raise ValueRangeError(f"motion {self.name!r} has a single frame, and so no frame rate")
        return (self.frames - 1) / self.duration

    def trim(self, start: float = 0.0, end: float | None = None) -> "RobotMotion":
        """The frames from `start` to `end` [s] after the first, both included; the new motion begins at time 0.

        Raises:
            ValueRangeError: no frame lies between the two, or they lie outside of the motion.
        """
        end = self.duration if end is None else end
        since = self.times - self.times[0]
        rounding = 1e-6 * (self.duration / max(self.frames - 1, 1))
        if not (-rounding <= start <= end <= self.duration + rounding):
            raise ValueRangeError(
                f"can't trim motion {self.name!r} to {start:g} s .. {end:g} s: it lasts from 0 to {self.duration:g} s"
            )
        kept = (since >= start - rounding) & (since <= end + rounding)
        if not kept.any():
            raise ValueRangeError(f"motion {self.name!r} has no frame between {start:g} s and {end:g} s")
        return replace(self, configurations=self.configurations[kept], times=since[kept] - since[kept][0])
