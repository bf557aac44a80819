"""How a fabric looks: its weave, how fine that is, its colours, and those of what it is sewn with."""

from dataclasses import dataclass, field

from cape.cloth.looks import weaves
from cape.cloth.looks.weaves import Weave

Color = tuple[int, int, int]

NIGHT: Color = (58, 66, 104)


@dataclass(frozen=True, kw_only=True)
class Look:
    """How a fabric looks.

    Attributes:
        weave: how its threads lie.
        repeat: width of a repeat of the weave [m].
        color: of the warp, or of all, sRGB.
        weft: of the weft; None for that of the warp.
        lining: of the inside.
        trim: of the hem and the collar's edge; None for that of the fabric.
        relief: how much its height shows in light and shade, 1 for a matt cloth.
        rough: how matt it is, from 0 for a mirror to 1.
        slub: how uneven its threads are dyed, as a share of their brightness.
    """

    color: Color
    weave: Weave = field(default=weaves.PLAIN, compare=False)
    repeat: float = 0.001
    weft: Color | None = None
    lining: Color = NIGHT
    trim: Color | None = None
    relief: float = 1.0
    rough: float = 0.9
    slub: float = 0.04
