"""Cloaks down to the ankles, wide enough to close all around; one has a hood."""

import math

from cape.garments.base import Garment
from cape.garments.collared import Cut

OPEN = math.radians(8.0)  # left open on either side of the middle of the front, for the clasp
CLOAK = Garment(
    "cloak",
    "lies on both shoulders and falls to the ankles, wide enough to close all around",
    Cut(length=0.76, flare=2.3, begin=math.pi - OPEN, end=OPEN - math.pi).fit,
)
HOODED_CLOAK = Garment(
    "hooded_cloak",
    "a cloak that goes on above the neck as a hood, which is worn over the head",
    Cut(length=0.76, flare=2.3, begin=math.pi - OPEN, end=OPEN - math.pi, hooded=True).fit,
)
