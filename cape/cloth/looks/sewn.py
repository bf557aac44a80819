"""The texture of a whole cloth: its fabric in its own measures, hem, collar's edge and seams."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.cloth.cloth import Cloth, GridCloth, MeshCloth
from cape.cloth.looks.look import Look
from cape.cloth.looks.maps import TextureArray, maps_of, softened
from cape.cloth.looks.registry import look_of
from cape.cloth.patches.patchwork import Patchwork
from cape.cloth.tailoring import HEM

FloatArray = NDArray[np.floating]

MAGNIFIED = 10.0  # times its true size a weave is drawn: the viewer has no mipmaps, and finer ones would shimmer
TEXELS = 300_000  # of a cloth, at most
TEXEL = 0.0035  # m, at least: a figure that fills a view of 900 pixels has some 2 mm a pixel
TILE_TEXELS = 256  # of the piece of fabric that is repeated
BLUR = 0.7  # texels, so that threads too fine for them leave no pattern of their own
CONTRAST = 0.08  # standard deviation of a weave's brightness at most, as a share: more would shimmer
STITCH = 0.011, 0.6  # m from a stitch to the next, of which it takes this share
SEAM = 0.004  # m, half the width of the furrow of a seam
WAVES = 5
MOTTLE = 0.03, 0.22  # how uneven cloth is dyed, as a share of its brightness, and over how much of it [m]


def texture_of(cloth: Cloth, look: Look, *, texels: int = TEXELS) -> TextureArray:
    """Draw a cloth over its texture coordinates in so many texels at most, sRGB, shape (height, width, 3).

    A cloth that has textures of its own is drawn in those, as large as they are; pieces of different fabrics are drawn
    in the looks of these.
    """
    if cloth.textures is not None:
        return cloth.textures.albedo
    if isinstance(cloth, MeshCloth) and cloth.patchwork is not None:
        return _of_pieces(cloth, cloth.patchwork, texels)
    across, down, edge, seam, bright = _measures(cloth, texels)
    texel = float(max(np.abs(np.diff(across, axis=1)).max(), np.abs(np.diff(down, axis=0)).max()))
    tile, size = maps_of(look, texels=TILE_TEXELS), TILE_TEXELS
    pitch = MAGNIFIED * tile.size / size
    fabric = _tempered(softened(tile.baked, BLUR * texel / pitch)).reshape(-1, 3)
    places = (down / pitch).astype(np.int64) % size * size + (across / pitch).astype(np.int64) % size
    drawn = fabric.take(places, axis=0)
    if look.trim is not None:
        hem = edge < HEM + texel
        tones = fabric.mean(axis=1) / fabric.mean()
        trim = np.array(look.trim, np.float32) * tones[places[hem], None]
        drawn[hem] += _within(edge[hem], HEM, texel)[:, None] * (trim - drawn[hem])
    along = np.where(seam < HEM, down, across + down)
    stitched = (along / STITCH[0]) % 1.0 < STITCH[1]
    furrow = 0.30 * _near(edge, HEM, texel, texel)
    furrow += 0.20 * stitched * _near(edge, 0.8 * HEM, 0.6 * texel, texel)
    if np.isfinite(seam[0, 0]):
        furrow += 0.30 * _near(seam, 0.0, SEAM, texel) + 0.20 * stitched * _near(seam, 2.5 * SEAM, 0.6 * texel, texel)
    drawn *= (bright * (1.0 - np.minimum(furrow, 0.5)))[..., None]
    return np.minimum(drawn + 0.5, 255.0).astype(np.uint8)


def _of_pieces(cloth: MeshCloth, patches: Patchwork, texels: int) -> TextureArray:
    """The texture of a mesh of several fabrics: at each texel that of the nearest vertex of the pattern."""
    from scipy.spatial import KDTree

    alone = [replace(cloth, fabric=fabric, patchwork=None) for fabric in patches.fabrics]
    drawn = np.stack([texture_of(each, look_of(each.fabric), texels=texels) for each in alone])
    across, down, *_ = _measures(cloth, texels)
    places = np.stack([across, down], axis=-1) + cloth.pattern.min(axis=0)
    number = patches.at_vertices(cloth.faces)[KDTree(cloth.pattern).query(places)[1]]
    return np.take_along_axis(drawn, number[None, ..., None], axis=0)[0]


def _tempered(fabric: FloatArray) -> FloatArray:
    """A texture whose brightness does not vary by more than `CONTRAST`, shape (n, n, 3)."""
    plain = fabric.mean(axis=(0, 1))
    varies = float(fabric.mean(axis=2).std()) / float(plain.mean())
    return plain + min(1.0, CONTRAST / max(varies, 1e-9)) * (fabric - plain)


class _Measures(NamedTuple):
    """For each texel its place across and down in the pattern, how far it is from the nearest edge and from the nearest
    seam [m], and how bright the cloth is dyed there, about 1; shape (height, width) each."""

    across: FloatArray
    down: FloatArray
    edge: FloatArray
    seam: FloatArray
    bright: FloatArray


def _measures(cloth: Cloth, texels: int) -> _Measures:
    if not isinstance(cloth, GridCloth):
        # Texture coordinates are the pattern, the longer side of which goes from 0 to 1.
        extent = float(np.ptp(cloth.pattern, axis=0).max())
        side = max(round(min(extent / TEXEL, np.sqrt(texels))), 2)
        places = extent * (np.arange(side, dtype=np.float32) + 0.5) / side
        across, down = np.meshgrid(places, places)
        far = np.full_like(across, np.inf)
        return _Measures(across, down, far, far, _mottled(across, down))
    pattern = cloth.pattern.reshape(cloth.rows, cloth.columns, 2)
    ways = [_ways(pattern, axis) for axis in (1, 0)]
    width, length = (float(way.max()) for way in ways)
    texel = max(TEXEL, float(np.sqrt(width * length / texels)))
    size = [max(round(side / texel), 2) for side in (length, width)]
    to_left, to_top = (_enlarged(way, *size) for way in ways)
    to_right, to_bottom = (
        _enlarged(way.max(axis=axis, keepdims=True) - way, *size) for way, axis in zip(ways, (1, 0), strict=True)
    )
    seams = [np.abs(_enlarged(ways[0] - ways[0][:, [column]], *size)) for column in cloth.seams]
    return _Measures(
        _enlarged(pattern[..., 0], *size),
        _enlarged(pattern[..., 1], *size),
        np.minimum.reduce([to_left, to_top, to_right, to_bottom]),
        np.minimum.reduce(seams) if seams else np.full(size, np.inf, np.float32),
        _enlarged(_mottled(*np.moveaxis(pattern, 2, 0)), *size),
    )


def _ways(places: FloatArray, axis: int) -> FloatArray:
    """How far it is along the threads from where they begin [m], of places (rows, columns, 2), along an axis."""
    steps = np.linalg.norm(np.diff(places, axis=axis), axis=2)
    return np.insert(np.cumsum(steps, axis=axis), 0, 0.0, axis=axis)


def _enlarged(values: FloatArray, height: int, width: int) -> FloatArray:
    """Values on a grid (rows, columns), on straight lines between them at texels, shape (height, width)."""
    values = values.astype(np.float32)
    for axis, count in ((0, height), (1, width)):
        places = (np.arange(count) + 0.5) / count * (values.shape[axis] - 1)
        first = np.minimum(places.astype(np.int64), values.shape[axis] - 2)
        share = np.expand_dims(places - first, 1 - axis).astype(np.float32)
        before = values.take(first, axis)
        values = before + share * (values.take(first + 1, axis) - before)
    return values


def _within(distance: FloatArray, width: float, soft: float) -> FloatArray:
    """1 up to a distance, 0 beyond it, and between the two over `soft` [m]."""
    return np.clip((width - distance) / soft + 0.5, 0.0, 1.0)


def _near(distance: FloatArray, line: float, width: float, soft: float) -> FloatArray:
    """1 on a line, and down to 0 at a width to either side, at least `soft` [m]."""
    return np.clip(1.0 - np.abs(distance - line) / max(width, soft), 0.0, 1.0)


def _mottled(across: FloatArray, down: FloatArray) -> FloatArray:
    """How bright cloth is dyed at places [m], about 1: a sum of waves that are no multiples of each other."""
    depth, wave = MOTTLE
    rng, total = np.random.default_rng(3), np.zeros(across.shape)
    for _ in range(WAVES):
        angle, phase = rng.uniform(0.0, 2.0 * np.pi, 2)
        rate = 2.0 * np.pi / (wave * rng.uniform(0.6, 1.6))
        total += np.sin(rate * (np.cos(angle) * across + np.sin(angle) * down) + phase)
    return (1.0 + depth * total / np.sqrt(WAVES)).astype(np.float32)
