"""A half cape, worn over the left shoulder."""

import math

from cape.garments.base import Garment
from cape.garments.collared import Cut

HALF_CAPE = Garment(
    "half_cape",
    "lies on the left shoulder, from the middle of the chest to the right shoulder blade",
    Cut(length=0.5, flare=1.9, begin=math.radians(168.0), end=math.radians(-50.0)).fit,
)
