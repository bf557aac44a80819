"""How a cloth touches itself."""

from dataclasses import dataclass

from motions.border import checked_first
from motions.errors import ValueRangeError


@checked_first
@dataclass(frozen=True, kw_only=True)
class SelfContact:
    """Layers of a cloth stay a thickness apart, and rub.

    Attributes:
        thickness: distance of the layers' middles [m]; None for a third of the cloth's mean edge, at most 5 mm. At that
            distance nothing touches along the cloth unless it is sharply folded. A larger one costs more, and layers
            that are nearer than it at rest, along the flat pattern, are left alone.
        friction: Coulomb coefficient between layers; None for the scene's.
    """

    thickness: float | None = None
    friction: float | None = None

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ValueRangeError: the thickness is not positive and finite, or the friction negative or not finite.
        """
        if self.thickness is not None and not 0.0 < self.thickness < float("inf"):
            raise ValueRangeError(f"the thickness for self-contact must be positive and finite, not {self.thickness}")
        if self.friction is not None and not 0.0 <= self.friction < float("inf"):
            raise ValueRangeError(f"the friction of self-contact must be zero or more and finite, not {self.friction}")
