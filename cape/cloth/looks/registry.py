"""The looks there are: one for each fabric."""

from typing import Final

from cape.cloth.fabric import Fabric
from cape.cloth.fabrics import FABRICS
from cape.cloth.looks import weaves
from cape.cloth.looks.look import Color, Look

GOLD: Color = (214, 170, 92)

LOOKS: Final[dict[str, Look]] = {
    "cape": Look(color=(190, 22, 48), weave=weaves.twill(2, 2), repeat=0.0024, trim=GOLD),
    "worsted": Look(
        color=(70, 74, 88),
        weave=weaves.twill(2, 2),
        repeat=0.0016,
        weft=(82, 86, 100),
        lining=(120, 44, 52),
    ),
    "denim": Look(
        color=(48, 70, 116),
        weave=weaves.twill(3, 1),
        repeat=0.002,
        weft=(206, 206, 198),
        lining=(150, 158, 172),
        trim=(44, 62, 104),
        slub=0.1,
    ),
    "jersey": Look(color=(152, 154, 160), weave=weaves.knit(), repeat=0.0009, lining=(120, 122, 128), slub=0.02),
    "ponte": Look(color=(188, 142, 92), weave=weaves.knit(), repeat=0.0011, lining=(150, 110, 70), slub=0.015),
    "rib": Look(color=(222, 212, 190), weave=weaves.knit(2), repeat=0.004, lining=(196, 184, 160), slub=0.01),
    "sweater": Look(color=(44, 56, 92), weave=weaves.knit(), repeat=0.0024, lining=(36, 44, 72), slub=0.05),
    "fleece": Look(color=(122, 84, 64), weave=weaves.pile, repeat=0.003, lining=(206, 140, 150), rough=1.0),
    "jacket": Look(color=(214, 74, 34), repeat=0.0006, lining=(60, 60, 66), rough=0.6),
    "swim": Look(
        color=(226, 230, 232), weave=weaves.knit(), repeat=0.0006, lining=(196, 204, 210), rough=0.5, slub=0.015
    ),
    "tablecloth": Look(
        color=(68, 68, 76),
        weave=weaves.satin(5, 2),
        repeat=0.0015,
        lining=(196, 192, 186),
        trim=(226, 222, 214),
    ),
    "twill": Look(color=(44, 76, 168), weave=weaves.twill(2, 1), repeat=0.0016, lining=(206, 176, 84)),
    "broadcloth": Look(color=(216, 206, 178), repeat=0.0008, lining=(142, 116, 84)),
    "wool-tropical": Look(color=(116, 118, 112), repeat=0.0011, weft=(138, 140, 134), lining=(70, 84, 78)),
    "polyester-tropical": Look(color=(138, 104, 74), repeat=0.001, weft=(152, 116, 84), lining=(84, 58, 44)),
    "faille": Look(
        color=(22, 112, 84),
        weave=weaves.RIBBED,
        repeat=0.0024,
        lining=(206, 176, 110),
        rough=0.45,
        relief=1.3,
    ),
    "chiffon-weight": Look(color=(222, 152, 160), repeat=0.0006, lining=(232, 176, 180), slub=0.02, rough=0.7),
    "lining-weight": Look(
        color=(122, 28, 60),
        weave=weaves.satin(5, 2),
        repeat=0.001,
        lining=(146, 50, 82),
        rough=0.35,
    ),
    "leather-weight": Look(
        color=(106, 64, 38),
        weave=weaves.grain,
        repeat=0.0018,
        lining=(166, 130, 92),
        rough=0.55,
        slub=0.0,
    ),
}
"""A look for each of `FABRICS`. Colours are such as their sources name, else chosen to tell them apart."""


def look_of(fabric: Fabric) -> Look:
    """The look of a fabric, that of the default one for a fabric that has none of its own."""
    return next((LOOKS[name] for name, known in FABRICS.items() if known == fabric), LOOKS["cape"])
