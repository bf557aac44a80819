"""What a live run tells of itself."""

from dataclasses import dataclass, replace


@dataclass(frozen=True)
class Status:
    """How a live run goes.

    Attributes:
        frame: number of the newest frame.
        time: of the simulation [s].
        clock: time since the first frame by the clock [s].
        step_ms: mean wall time of a step [ms].
        late_ms: how late steps begin on average [ms].
        factor: time of the simulation over the clock's, 1 in real time.
        solver: its name.
        substeps: in the last frame.
        error_mm: estimate of what the time step costs in a tenth of a second [mm]; not a number where it is not known.
        speed: that was asked for, 1 for real time.
        paused: whether it stands still.
        given_up: what was given up to keep pace, empty for nothing.
        viewer: how the viewer does, empty where there is nothing to say.
        building: what is being made ready, empty for nothing.
        message: what was said last.
        ended: why the run has ended, empty while it goes on.
    """

    frame: int = 0
    time: float = 0.0
    clock: float = 0.0
    step_ms: float = 0.0
    late_ms: float = 0.0
    factor: float = 1.0
    solver: str = ""
    substeps: int = 0
    error_mm: float = float("nan")
    speed: float = 1.0
    paused: bool = False
    given_up: str = ""
    viewer: str = ""
    building: str = ""
    message: str = ""
    ended: str = ""

    def but(self, **changes: object) -> "Status":
        """The same with some of it changed."""
        return replace(self, **changes)  # pyright: ignore[reportArgumentType]

    def line(self, width: int = 120) -> str:
        """All of it in a line of so many columns."""
        error = "" if self.error_mm != self.error_mm else f", {self.error_mm:.2f} mm"
        parts = [
            f"frame {self.frame}",
            "paused" if self.paused else f"{self.step_ms:.1f} ms, {self.factor * self.speed:.2f}x",
            f"{self.solver} {self.substeps}{error}",
            *(part for part in (self.given_up, self.viewer, self.building and f"making {self.building}") if part),
            *([self.message] if self.message else []),
        ]
        return " | ".join(parts)[: max(width - 1, 10)]
