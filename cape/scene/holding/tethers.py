"""What keeps a cloth from being drawn out: tethers along it."""

from dataclasses import dataclass

from motions.border import checked
from motions.errors import ValueRangeError


@checked
@dataclass(frozen=True, kw_only=True)
class Tethers:
    """No vertex gets farther from the nearest one that is held hard than the cloth between the two is long.

    The long range attachments of Kim, Chentanez and Müller-Fischer 2012, "Long Range Attachments - A Method to Simulate
    Inextensible Clothing in Computer Games": the length is that of the shortest way along springs at rest, on a grid up
    to 8 % more than along the cloth itself, where that leads neither along threads nor diagonals.

    Attributes:
        slack: by which the way may be longer than that, as a share of it.
    """

    slack: float = 0.02

    def __post_init__(self) -> None:
        """Check the value.

        Raises:
            ValueRangeError: the slack is negative or not finite.
        """
        if not 0.0 <= self.slack < float("inf"):
            raise ValueRangeError(f"the slack of tethers must be zero or more and finite, not {self.slack}")
