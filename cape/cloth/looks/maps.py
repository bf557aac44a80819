"""Textures of a fabric, made of its relief: colour, normals and roughness."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.cloth.drawn.textures import Textures
from cape.cloth.looks.look import Look

TextureArray = NDArray[np.uint8]
FloatArray = NDArray[np.floating]

REPEATS = 8  # of the weave along a side: so that no two neighbours are dyed alike
LIGHT = np.array([-0.45, -0.6, 0.66])  # whence the baked light comes, to the right, down, and out of the cloth
BAKED = 0.55  # how much of the brightness it makes
HOLLOW = 0.45  # by which the deepest place is darker than the highest


class Maps(NamedTuple):
    """Textures of a square piece of fabric that can be laid beside itself, rows going down along the warp.

    Attributes:
        albedo: sRGB, without light, shape (n, n, 3).
        normal: as glTF 2.0 takes it: x to the right, y up, z out of the cloth, -1 to 1 as 0 to 255, shape (n, n, 3).
        roughness: 0 to 1 as 0 to 255, shape (n, n).
        baked: the albedo with light and shade of the relief, for a viewer that knows nothing else, shape (n, n, 3).
        size: of the piece [m].
    """

    albedo: TextureArray
    normal: TextureArray
    roughness: TextureArray
    baked: TextureArray
    size: float


def maps_of(look: Look, *, texels: int = 512) -> Maps:
    """Make the textures of a fabric, `texels` along a side, eight repeats of its weave wide."""
    relief = look.weave(REPEATS, texels)
    size = REPEATS * look.repeat
    height, step = relief.height, size / texels
    metres = relief.deep * look.repeat * height
    slopes = [(np.roll(metres, -1, axis) - np.roll(metres, 1, axis)) / (2.0 * step) for axis in (1, 0)]
    normal = np.stack([-slopes[0], slopes[1], np.ones_like(height)], axis=2)
    normal /= np.linalg.norm(normal, axis=2, keepdims=True)
    colors = np.array([look.color, look.weft or look.color], dtype=np.float32)
    dyed = np.random.default_rng(0).normal(0.0, look.slub, (2, int(relief.thread.max()) + 1)).astype(np.float32)
    weft = relief.weft.astype(int)
    albedo = colors[weft] * (1.0 + dyed[weft, relief.thread])[..., None]
    light = np.maximum(normal @ (LIGHT * [1.0, -1.0, 1.0]), 0.0) / LIGHT[2]
    shade = 1.0 + look.relief * (BAKED * (light - 1.0) - HOLLOW * (1.0 - height))
    shade = np.clip(shade / shade.mean(), 0.2, 1.6)
    roughness = np.clip(look.rough + 0.1 * (0.5 - height), 0.0, 1.0)
    return Maps(
        _bytes(albedo),
        _bytes(127.5 * (normal + 1.0)),
        _bytes(255.0 * roughness),
        _bytes(albedo * shade[..., None]),
        size,
    )


def textures_of(look: Look, *, texels: int = 512) -> Textures:
    """The textures of a square piece of fabric that can be laid beside itself; fabric has no metal."""
    maps = maps_of(look, texels=texels)
    packed = np.zeros_like(maps.albedo)
    packed[..., 1] = maps.roughness
    return Textures(maps.albedo, maps.normal, packed)


def softened(texture: TextureArray, width: float) -> FloatArray:
    """A texture that can be laid beside itself, blurred by a Gaussian of a standard deviation in texels, (n, n, 3)."""
    n = len(texture)
    squares = np.add.outer(np.fft.fftfreq(n) ** 2, np.fft.rfftfreq(n) ** 2)
    kept = np.exp(-2.0 * (np.pi * width) ** 2 * squares)[..., None]
    return np.fft.irfft2(np.fft.rfft2(texture, axes=(0, 1)) * kept, s=(n, n), axes=(0, 1)).astype(np.float32)


def _bytes(values: NDArray[np.floating]) -> TextureArray:
    return np.rint(values).clip(0, 255).astype(np.uint8)
