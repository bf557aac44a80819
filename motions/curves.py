"""Smooth curves over time: steps, curves through keys, and periodic curves through tabulated samples."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

FloatArray = NDArray[np.float64]


def step(x: ArrayLike, start: float, end: float) -> FloatArray:
    """0 before `start`, 1 after `end`, between them 6 s^5 - 15 s^4 + 10 s^3: second derivatives are continuous."""
    s = np.clip((np.asarray(x, dtype=float) - start) / (end - start), 0.0, 1.0)
    return s**3 * (10 + s * (6 * s - 15))


def quintic(
    x: ArrayLike, start: float, end: float, at_start: Sequence[ArrayLike], at_end: Sequence[ArrayLike]
) -> FloatArray:
    """The polynomial of degree 5 with given value, first and second derivative at both ends.

    Args:
        x: where to evaluate it, shape (F,).
        start: where the polynomial begins.
        end: where it ends.
        at_start: value and first and second derivative by x at the start, scalars or shape (D,).
        at_end: the same at the end.

    Returns:
        Values, shape (F,) or (F, D).
    """
    span = end - start
    s = (np.asarray(x, dtype=float) - start) / span
    scale = (1.0, span, span**2)
    p0, v0, a0 = (np.asarray(value, dtype=float) * factor for value, factor in zip(at_start, scale, strict=True))
    p1, v1, a1 = (np.asarray(value, dtype=float) * factor for value, factor in zip(at_end, scale, strict=True))
    rise, speed, bend = p1 - p0 - v0 - a0 / 2, v1 - v0 - a0, a1 - a0
    coefficients = (
        p0,
        v0,
        a0 / 2,
        10 * rise - 4 * speed + bend / 2,
        -15 * rise + 7 * speed - bend,
        6 * rise - 3 * speed + bend / 2,
    )
    powers = [np.multiply.outer(s**k, np.ones(np.shape(p0))) for k in range(6)]
    return sum((c * p for c, p in zip(coefficients, powers, strict=True)), np.zeros_like(powers[0]))


def between_rows(at: FloatArray, rows: FloatArray, x: ArrayLike) -> FloatArray:
    """Rows (F, n) that belong to increasing places (F,), at other places (...): on straight lines between, (..., n)."""
    x = np.clip(np.asarray(x, dtype=float), at[0], at[-1])
    if len(at) == 1:
        return np.broadcast_to(rows[0], (*x.shape, rows.shape[1])).copy()
    before = np.clip(np.searchsorted(at, x, side="right") - 1, 0, len(at) - 2)
    share = ((x - at[before]) / (at[before + 1] - at[before]))[..., None]
    return (1.0 - share) * rows[before] + share * rows[before + 1]


def keyed(x: ArrayLike, *keys: tuple[float, float]) -> FloatArray:
    """A smooth curve through keys (x, value) that never overshoots them, constant before the first and after the last.

    Monotone cubic interpolation: slopes are weighted harmonic means of the neighbouring secants and zero at extremes;
    F. N. Fritsch and J. Butland, "A method for constructing local monotone piecewise cubic interpolants", SIAM J. Sci.
    Stat. Comput. 5 (1984), eq. 5. Its second derivative jumps at the keys, but stays bounded.
    """
    at, values = np.array(keys, dtype=float).T
    h, secants = np.diff(at), np.diff(values) / np.diff(at)
    slopes = np.zeros(len(at))
    before, after = secants[:-1], secants[1:]
    same = before * after > 0
    share = (h[:-1] + 2 * h[1:]) / (3 * (h[:-1] + h[1:]))
    mean = share[same] / before[same] + (1 - share[same]) / after[same]
    slopes[1:-1][same] = 1 / mean
    x = np.clip(np.asarray(x, dtype=float), at[0], at[-1])
    i = np.clip(np.searchsorted(at, x, side="right") - 1, 0, len(at) - 2)
    s = (x - at[i]) / h[i]
    return (
        values[i]
        + (values[i + 1] - values[i]) * s**2 * (3 - 2 * s)
        + h[i] * s * (1 - s) * (slopes[i] * (1 - s) - slopes[i + 1] * s)
    )


def bridged(
    x: FloatArray, grounded: FloatArray, free: FloatArray, *, leave: float, land: float, fade: float, slope_fade: float
) -> FloatArray:
    """`grounded` up to `leave` and from `land` on; between them `free`, joined without a jump in value or slope.

    The difference between the two at either end is carried over into the free part and faded out: its value within
    `fade`, its slope within `slope_fade`.

    Args:
        x: increasing, evenly spaced, shape (F,), with three samples or more before `leave` and after `land`.
        grounded: shape (F,) or (F, D); what it holds between `leave` and `land` is not used.
        free: the same shape; used between the two, and near their ends.
        leave: where the free part begins.
        land: where it ends.
        fade: in the unit of x.
        slope_fade: in the unit of x.
    """
    error = np.reshape(grounded - free, (len(x), -1))
    spacing = x[1] - x[0]
    last = int(np.flatnonzero(x <= leave)[-1])
    first = int(np.flatnonzero(x >= land)[0])
    carried = np.zeros_like(error)
    for at, inwards in ((last, -1), (first, 1)):
        slope = inwards * (-3 * error[at] + 4 * error[at + inwards] - error[at + 2 * inwards]) / (2 * spacing)
        away = x - x[at]
        value, straight = (1 - step(np.abs(away), 0.0, within) for within in (fade, slope_fade))
        carried += np.outer(value, error[at]) + np.outer(straight * away, slope)
    between = (np.arange(len(x)) > last) & (np.arange(len(x)) < first)
    return free + np.where(between[:, None], carried, error).reshape(free.shape)


def periodic(phase: ArrayLike, samples: ArrayLike, harmonics: int) -> FloatArray:
    """Fourier series through samples that are evenly spaced over one period, cut after some harmonics.

    Args:
        phase: in periods, shape (F,).
        samples: at phases 0, 1/n, ..., (n - 1)/n, shape (n,).
        harmonics: how many to keep, fewer than n / 2.
    """
    samples = np.asarray(samples, dtype=float)
    spectrum = np.fft.rfft(samples)[: harmonics + 1] / len(samples)
    spectrum[1:] *= 2
    waves = np.exp(2j * np.pi * np.multiply.outer(np.asarray(phase, dtype=float), np.arange(harmonics + 1)))
    return (waves @ spectrum).real
