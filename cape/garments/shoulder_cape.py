"""A cape that lies on both shoulders, closes at the front of the neck and falls open over the chest."""

import math

from cape.garments.base import Garment
from cape.garments.collared import Cut

OPEN = math.radians(12.0)  # left open on either side of the middle of the front, for the clasp
SHOULDER_CAPE = Garment(
    "shoulder_cape",
    "lies on both shoulders, closes at the front of the neck, falls open over the chest",
    Cut(length=0.62, flare=1.9, begin=math.pi - OPEN, end=OPEN - math.pi).fit,
)
