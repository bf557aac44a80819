"""The garments there are: a line for each."""

from cape.garments.back_cape import BACK_CAPE
from cape.garments.base import Garment
from cape.garments.cloak import CLOAK
from cape.garments.half_cape import HALF_CAPE
from cape.garments.shoulder_cape import SHOULDER_CAPE
from motions.errors import UnknownNameError

GARMENTS: dict[str, Garment] = {garment.name: garment for garment in (BACK_CAPE, SHOULDER_CAPE, CLOAK, HALF_CAPE)}
DEFAULT = SHOULDER_CAPE.name


def garment(name: str) -> Garment:
    """The garment of that name.

    Raises:
        UnknownNameError: there is none; lists them.
    """
    if name not in GARMENTS:
        raise UnknownNameError("garment", name, GARMENTS)
    return GARMENTS[name]
