"""Which pictures a gallery has."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import motions
from cape.cloth.fabrics import fabric
from cape.garments import registry
from motions.errors import UnknownNameError

CLIPS = ("walk", "run", "spin")
PLAIN_FABRIC = "cape"  # what a garment is made of unless another is asked for


@dataclass(frozen=True)
class Costume:
    """A garment of a fabric.

    Attributes:
        garment: its name.
        fabric: its name.
    """

    garment: str
    fabric: str

    @property
    def title(self) -> str:
        """What it is called on the page."""
        plain = "" if self.fabric == PLAIN_FABRIC else f" of {_words(self.fabric)}"
        return f"{_words(self.garment)}{plain}"

    def file(self, clip: str) -> str:
        """Name of the picture of it in a clip."""
        return f"{self.garment}_{self.fabric}_{clip}.jpg"


def costumes(garments: Sequence[str], fabrics: Sequence[str], names: Sequence[str]) -> tuple[Costume, ...]:
    """What to show.

    Args:
        garments: those that were asked for, and
        fabrics: of which they are to be: each garment of each fabric, or of the plain one, or each fabric on the
            garment that is worn by default. With none of both every garment is shown in the plain fabric, and every
            fabric as the default garment.
        names: of all fabrics there are.

    Raises:
        UnknownNameError: there is no such garment or fabric.
    """
    for name in garments:
        registry.garment(name)
    for name in fabrics:
        fabric(name)
    if garments or fabrics:
        pairs = product(garments or [registry.DEFAULT], fabrics or [PLAIN_FABRIC])
    else:
        pairs = [(name, PLAIN_FABRIC) for name in registry.GARMENTS]
        pairs += [(registry.DEFAULT, name) for name in names if name != PLAIN_FABRIC]
    return tuple(dict.fromkeys(Costume(*pair) for pair in pairs))


def clips(asked: Sequence[str]) -> tuple[str, ...]:
    """Names of the shipped clips to show it in.

    Raises:
        UnknownNameError: there is no such clip.
    """
    for name in asked:
        if name not in motions.clip_names():
            raise UnknownNameError("clip", name, motions.clip_names())
    return tuple(dict.fromkeys(asked)) or CLIPS


def _words(name: str) -> str:
    return name.replace("_", " ")
