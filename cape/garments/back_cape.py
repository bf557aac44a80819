"""A cape that hangs from both shoulders behind the back."""

import numpy as np

from cape.cloth.cloth import Cloth
from cape.garments.base import Garment, Hold, Measures, Worn
from cape.garments.fitting import Fitted

LENGTH = 0.62  # of the body's height: from the shoulders to the middle of the shins
FLARE = 2.0
SPACING = 0.0137  # of the body's height, for about 1,500 vertices
# Skeletons place shoulder joints anywhere from the neck's side to the deltoid; a cape is cut to a plausible width.
NARROWEST, WIDEST = 0.19, 0.26  # of the body's height


def fit(fitted: Fitted, measures: Measures) -> Worn:
    """Cut it as wide as the shoulders, and hang it on them by both ends of its neckline."""
    height = fitted.height
    length, flare, spacing = measures.sizes(height, length=LENGTH, flare=FLARE, spacing=SPACING)
    cloth = Cloth.cape(
        length=length,
        flare=flare,
        spacing=spacing,
        shoulder_width=float(np.clip(fitted.shoulder_width, NARROWEST * height, WIDEST * height)),
        fabric=measures.fabric,
    )
    held = tuple(Hold(f"{side}_shoulder", f"top_{side}") for side in ("left", "right"))
    return Worn(cloth, held)


BACK_CAPE = Garment("back_cape", "hangs from both shoulders behind the back", fit)
