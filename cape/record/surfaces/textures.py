"""Textures as the viewer takes them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from cape.cloth.looks.look import Color


def plain(color: Color) -> NDArray[np.uint8]:
    """A texture of one colour, sRGB, shape (2, 2, 3)."""
    return np.full((2, 2, 3), color, np.uint8)


def albedo(texture: NDArray[np.uint8]) -> dict[str, Any]:
    """The components of a mesh that make an sRGB texture (height, width, 3) its colour."""
    import rerun as rr

    size = {"width": texture.shape[1], "height": texture.shape[0]}
    image_format = rr.components.ImageFormat(**size, color_model="RGB", channel_datatype="U8")
    return {"albedo_texture_buffer": texture.tobytes(), "albedo_texture_format": image_format}
