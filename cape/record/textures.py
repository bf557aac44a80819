"""Textures made by rule."""

import numpy as np
from numpy.typing import NDArray

Color = tuple[int, int, int]
TEXELS = 512
HEM_COLOR: Color = (214, 168, 84)


def woven(color: Color, *, hem: Color = HEM_COLOR) -> NDArray[np.uint8]:
    """A twill of one colour with a double hem along its four edges, sRGB, shape (512, 512, 3).

    Args:
        color: of the cloth.
        hem: of the trim.
    """
    row, column = np.mgrid[:TEXELS, :TEXELS]
    # Diagonal ribs of 8 texels, crossed by threads of 4: visible close by, averaged out from afar.
    ribs = np.sin((row + column) * (2 * np.pi / 8))
    threads = np.sin(column * (2 * np.pi / 4)) * np.sin(row * (2 * np.pi / 4))
    brightness = 1.0 + 0.05 * ribs + 0.03 * threads
    to_edge = np.minimum.reduce([row, column, TEXELS - 1 - row, TEXELS - 1 - column]) / TEXELS
    trim = (to_edge < 0.022) | ((to_edge > 0.034) & (to_edge < 0.040))
    base = np.where(trim[..., None], np.array(hem, float), np.array(color, float))
    return np.clip(base * brightness[..., None], 0, 255).astype(np.uint8)
