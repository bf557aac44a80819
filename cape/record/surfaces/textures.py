"""Textures made by rule."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

Color = tuple[int, int, int]
TEXELS = 512
HEM_COLOR: Color = (222, 178, 92)
HEM_WIDTH, HEM_SOFT = 0.03, 0.006  # of the texture: the trim, and the way on which it passes into the cloth


def woven(color: Color, *, hem: Color = HEM_COLOR) -> NDArray[np.uint8]:
    """A twill of one colour with a trim along its four edges, sRGB, shape (512, 512, 3).

    Args:
        color: of the cloth.
        hem: of the trim.
    """
    row, column = np.mgrid[:TEXELS, :TEXELS]
    # The viewer has no mipmaps: finer ribs than 16 texels, or stronger ones, shimmer when the figure is far away, and a
    # line of few texels breaks into dashes where the cloth is seen edge on.
    brightness = 1.0 + 0.035 * np.sin((row + column) * (2 * np.pi / 16))
    to_edge = np.minimum.reduce([row, column, TEXELS - 1 - row, TEXELS - 1 - column]) / TEXELS
    trim = np.clip((HEM_WIDTH + HEM_SOFT - to_edge) / HEM_SOFT, 0.0, 1.0)[..., None]
    cloth = np.array(color) * brightness[..., None]
    return (trim * np.array(hem) + (1.0 - trim) * cloth).clip(0, 255).astype(np.uint8)


def plain(color: Color) -> NDArray[np.uint8]:
    """A texture of one colour, sRGB, shape (2, 2, 3)."""
    return np.full((2, 2, 3), color, np.uint8)


def albedo(texture: NDArray[np.uint8]) -> dict[str, Any]:
    """The components of a mesh that make an sRGB texture (height, width, 3) its colour."""
    import rerun as rr

    size = {"width": texture.shape[1], "height": texture.shape[0]}
    image_format = rr.components.ImageFormat(**size, color_model="RGB", channel_datatype="U8")
    return {"albedo_texture_buffer": texture.tobytes(), "albedo_texture_format": image_format}
