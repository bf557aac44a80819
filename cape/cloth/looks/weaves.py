"""How threads lie in a fabric: the relief of a piece of it that can be laid beside itself, and whose thread is on top.

Heights are made by formula, of no measured cloth: a thread is round across, and rises and sinks along itself between
the threads that it crosses over and under.
"""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float32]

FLAT = 0.95  # of half a thread's pitch: its own half width
SWING = 0.5  # of half a thread's pitch, by which it rises and sinks


class Relief(NamedTuple):
    """A square piece of n x n texels, rows going down along the warp.

    Attributes:
        height: 0 to 1, in units of `deep`, shape (n, n).
        weft: 1 where a weft thread is on top, 0 where a warp thread is, shape (n, n).
        thread: number of the thread that is seen, warp and weft apart, shape (n, n).
        deep: from the deepest place to the highest, in repeats of the weave.
    """

    height: FloatArray
    weft: FloatArray
    thread: NDArray[np.int64]
    deep: float


Weave = Callable[[int, int], Relief]
"""Makes the relief of so many repeats along a side in so many texels."""


def interlaced(over: ArrayLike) -> Weave:
    """A weave by its point paper: for each weft thread (row) and warp thread (column) of a repeat, whether the warp is
    on top, shape (N, N)."""
    return partial(_interlaced, np.asarray(over, dtype=bool))


def twill(over: int, under: int) -> Weave:
    """A twill whose warp goes over so many weft threads and under so many, one further on for each warp thread."""
    repeat = over + under
    return interlaced((np.add.outer(np.arange(repeat), np.arange(repeat)) % repeat) < over)


def satin(threads: int, step: int) -> Weave:
    """A satin of so many threads, each weft thread over one warp thread, so many further on than the one before."""
    over = np.ones((threads, threads), dtype=bool)
    over[np.arange(threads), step * np.arange(threads) % threads] = False
    return interlaced(over)


def _interlaced(over: NDArray[np.bool_], repeats: int, texels: int) -> Relief:
    paper = np.tile(np.where(over, 1.0, -1.0), (repeats, repeats))
    count = len(paper)
    places = (np.arange(texels) + 0.5) * count / texels
    own, off = places.astype(int), places % 1.0 - 0.5
    round_ = np.sqrt(np.maximum(1.0 - (2.0 * off / FLAT) ** 2, 0.0))
    before = np.floor(places - 0.5).astype(int)
    share = (1.0 - np.cos(np.pi * ((places - 0.5) - before))) / 2.0
    first, second = before % count, (before + 1) % count
    # Down a warp thread from crossing to crossing, and across a weft thread, which is up where the warp is down.
    along_warp = (1.0 - share)[:, None] * paper[first][:, own] + share[:, None] * paper[second][:, own]
    along_weft = (1.0 - share) * paper[own][:, first] + share * paper[own][:, second]
    warp, weft = SWING * along_warp + round_, round_[:, None] - SWING * along_weft
    on_top = weft > warp
    height = (np.maximum(warp, weft) + SWING) / (1.0 + 2.0 * SWING)
    thread = np.where(on_top, own[:, None], own)
    return Relief(height.astype(np.float32), on_top.astype(np.float32), thread, 0.5 * (1.0 + 2.0 * SWING) / len(over))


def knit(ribs: int = 0) -> Weave:
    """The right side of a knit, a V for each stitch; `ribs` wales stand out, and as many lie back, none where 0."""
    return partial(_knit, ribs)


def _knit(ribs: int, repeats: int, texels: int) -> Relief:
    wales = repeats * max(2 * ribs, 1)
    across, down = (np.arange(texels) + 0.5) * wales / texels, (np.arange(texels) + 0.5) * wales / texels
    off, way = np.abs(across % 1.0 - 0.5), (down % 1.0)[:, None]
    # A leg slants outwards as it goes up, and dives under the next stitch.
    leg = (off - (0.11 + 0.25 * (1.0 - way))) / 0.26
    height = np.maximum(np.sqrt(np.maximum(1.0 - leg**2, 0.0)) * (0.6 + 0.4 * np.sin(np.pi * way)), 0.25)
    if ribs:
        ridges = 0.5 + 0.5 * np.sin(np.pi * across / ribs)
        height = 0.3 * height + 0.7 * ridges
    thread = np.broadcast_to(down.astype(int)[:, None], height.shape)
    return Relief(height.astype(np.float32), np.ones_like(height, np.float32), thread, 0.4 / max(2 * ribs, 1))


def pile(repeats: int, texels: int) -> Relief:
    """Fibres that stand up in tufts, a few to a repeat."""
    frequency = np.hypot(*np.meshgrid(np.fft.fftfreq(texels), np.fft.rfftfreq(texels), indexing="ij")) * texels
    noise = np.random.default_rng(1).normal(size=(texels, texels))
    band = np.exp(-(((frequency - 2.0 * repeats) / (1.2 * repeats)) ** 2))
    height = np.fft.irfft2(np.fft.rfft2(noise) * band, s=noise.shape)
    height = np.clip(0.5 + height / (5.0 * height.std()), 0.0, 1.0)
    return _threadless(height, 0.3)


def grain(repeats: int, texels: int) -> Relief:
    """The grain of leather: a pebble to a repeat and furrows between them (a Voronoi diagram)."""
    rng = np.random.default_rng(2)
    seeds = rng.uniform(0.15, 0.85, (repeats, repeats, 2))
    places = (np.arange(texels) + 0.5) * repeats / texels
    cell, off = places.astype(int), places % 1.0
    nearest, second = (np.full((texels, texels), np.inf) for _ in range(2))
    for down in (-1, 0, 1):
        for right in (-1, 0, 1):
            seed = seeds[((cell + down) % repeats)[:, None], (cell + right) % repeats]
            apart = np.hypot(seed[..., 0] + right - off, seed[..., 1] + down - off[:, None])
            second = np.minimum(second, np.maximum(apart, nearest))
            nearest = np.minimum(nearest, apart)
    return _threadless(1.0 - np.exp(-6.0 * (second - nearest)), 0.15)


def _threadless(height: NDArray[np.float64], deep: float) -> Relief:
    return Relief(height.astype(np.float32), np.zeros(height.shape, np.float32), np.zeros(height.shape, np.int64), deep)


PLAIN = interlaced([[True, False], [False, True]])
"""Over one, under one."""

RIBBED = interlaced(np.repeat([[True, False, True, False], [False, True, False, True]], 2, axis=0))
"""A plain weave whose weft threads lie in pairs, which makes ribs across."""
