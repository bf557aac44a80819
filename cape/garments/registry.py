"""The garments there are: a line for each."""

from cape.garments.back_cape import BACK_CAPE
from cape.garments.base import Garment
from cape.garments.cloak import CLOAK, HOODED_CLOAK
from cape.garments.half_cape import HALF_CAPE
from cape.garments.sash import SASH
from cape.garments.shoulder_cape import SHOULDER_CAPE
from cape.garments.skirt import SKIRT
from cape.garments.tabard import TABARD
from motions.errors import UnknownNameError

GARMENTS: dict[str, Garment] = {
    garment.name: garment for garment in (BACK_CAPE, SHOULDER_CAPE, CLOAK, HOODED_CLOAK, HALF_CAPE, TABARD, SKIRT, SASH)
}
DEFAULT = SHOULDER_CAPE.name


def garment(name: str) -> Garment:
    """The garment of that name.

    Raises:
        UnknownNameError: there is none; lists them.
    """
    if name not in GARMENTS:
        raise UnknownNameError("garment", name, GARMENTS)
    return GARMENTS[name]
