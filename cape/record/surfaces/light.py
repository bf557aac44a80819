"""Colours as numbers of sRGB and as light, both 0 to 1, by IEC 61966-2-1."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


def linear(srgb: FloatArray) -> FloatArray:
    """Light of sRGB values."""
    return np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)


def srgb(linear: FloatArray) -> FloatArray:
    """The inverse of `linear`."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
