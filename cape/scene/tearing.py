"""When the threads of a cloth part."""

from dataclasses import dataclass

from motions.border import checked
from motions.errors import ValueRangeError


@checked
@dataclass(frozen=True, kw_only=True)
class Tearing:
    """A cloth parts where its threads are drawn too far, or where it bears too much.

    Both are measured as means over the cells or triangles around a vertex, so that in cloth that is drawn evenly
    neither depends on the spacing. At the tip of a tear, where tension has no bound, a finer cloth tears on at less.
    What a limit of strain, or tethers, take over from threads does not count: beyond the limit these part only where it
    can't be kept.

    Attributes:
        strain: of a thread at which it parts (0.2 is 20 %); None for any.
        force: per width of one layer at which the cloth parts, in whatever direction [N/m]; None for any.
    """

    strain: float | None = None
    force: float | None = None

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ValueRangeError: neither is given, or one is not positive and finite.
        """
        if self.strain is None and self.force is None:
            raise ValueRangeError("tearing needs a strain, or a force per width, at which threads part")
        for name in ("strain", "force"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < float("inf"):
                raise ValueRangeError(f"the {name} at which threads part must be positive and finite, not {value}")
