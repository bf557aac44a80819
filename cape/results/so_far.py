"""What a run gives away while it goes on, and how it is ended early."""

from typing import Protocol

from cape.results.take import Take


class SoFar(Protocol):
    """Gives the frames of a run that are done, as a take."""

    def __call__(self, first: int = 0) -> Take:
        """All of them, or those from one on, which is frame 0 of the take then; also when the run is over."""
        ...


class StopRun(Exception):
    """Raised by `on_frame`, ends a run as an interrupt does, with the frames that are done; its text is a warning."""
