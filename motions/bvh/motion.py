"""The second half of a BVH file: one row of numbers a frame."""

import re
import warnings
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from motions.bvh.hierarchy import Hierarchy, parse_number, why_no_number
from motions.bvh.source import Source, shown
from motions.limits import FASTEST, LARGEST_NUMBER, SLOWEST

FloatArray = NDArray[np.float64]

_WHOLE_RATES = (10, 12, 15, 20, 24, 25, 30, 48, 50, 60, 72, 75, 80, 90, 100, 120, 144, 150, 180, 200, 240, 250, 300)
_NEAR = 5e-4  # relative difference of a rate from a usual one: NTSC's are off by 1e-3
_LONGEST_EXPONENT = 4  # digits
# NTSC video runs slower by 1000/1001.
_USUAL_RATES = (*map(float, _WHOLE_RATES), *(rate / 1.001 for rate in (24, 30, 60, 120)))


@dataclass(frozen=True)
class Motion:
    """The rows of a file.

    Attributes:
        fps: frames per second.
        values: the channels' values in the file's unit and degrees, shape (F, columns).
        remarks: what was taken for something else than it says, a sentence each.
    """

    fps: float
    values: FloatArray
    remarks: tuple[str, ...] = ()


def parse_motion(source: Source, start: int, hierarchy: Hierarchy, rate: float | None = None) -> Motion:
    """Read the motion from byte `start`, where the keyword MOTION stands, at a `rate` [1/s] or the file's own.

    A frame may be wrapped over lines but begins on a new one, so a lost or doubled number is found in its own line.

    Raises:
        FileError: a malformed header or number, fewer frames than declared or more than one too many, a frame of the
            wrong length, a frame time that no motion has.
    """
    frames, frame_time, line, body = _parse_header(source, start)
    text = source.data[body:]
    if not text.strip():
        raise source.error(
            source.line_at(len(source.data.rstrip())), f"the file declares {frames} frames and holds none"
        )
    blank = np.frombuffer(text, dtype=np.uint8) <= ord(" ")
    starts = np.flatnonzero(~blank & np.concatenate([[True], blank[:-1]]))
    values = _parse_numbers(source, body, starts)
    remarks = []
    if len(starts) == (frames + 1) * hierarchy.columns:  # as of exporters that count from 0
        remarks.append(f"frames: the file declares {frames} and holds one more, which is taken for one, too")
        frames += 1
    _check_rows(source, body, starts, frames, hierarchy.columns)
    if rate is None:
        rate = _frame_rate(frame_time)
        if frames > 1 and not SLOWEST <= rate <= FASTEST:
            rate, remark = _meant_rate(source, line, frame_time)
            remarks.append(remark)
    return Motion(rate, values.reshape(frames, hierarchy.columns), tuple(remarks))


def _parse_header(source: Source, start: int) -> tuple[int, str, int, int]:
    """Number of frames, frame time as written, its line, and the offset at which the rows begin."""
    _, _, end = _text_line(source, start)
    line, number, end = _text_line(source, end)
    count = re.fullmatch(r"Frames\s*:?\s*(.*)", line, re.IGNORECASE)
    if count is None:
        raise source.error(number, "expected 'Frames: N' after MOTION")
    if not re.fullmatch(r"\+?\d{1,12}", count[1], re.ASCII) or int(count[1]) == 0:
        raise source.error(number, f"{shown(count[1])} is not a number of frames, at least 1")
    line, number, end = _text_line(source, end)
    time = re.fullmatch(r"Frame\s*Time\s*:?\s*(.*)", line, re.IGNORECASE)
    if time is None:
        raise source.error(number, "expected 'Frame Time: SECONDS' after the number of frames")
    seconds = parse_number(time[1])
    if seconds is None:
        raise source.error(number, f"Frame Time: {why_no_number(time[1])}")
    if not 1e-6 <= seconds <= 1e6:
        raise source.error(number, f"Frame Time: {shown(time[1])} is not a time above 0")
    return int(count[1]), time[1], number, end


def _text_line(source: Source, offset: int) -> tuple[str, int, int]:
    """The first line from an offset on that isn't blank ("" at the end), its number, and the offset behind it."""
    data = source.data
    while offset < len(data):
        end = data.find(b"\n", offset) + 1 or len(data)
        if line := data[offset:end].strip():
            return line.decode(errors="replace"), source.line_at(offset), end
        offset = end
    return "", source.line_at(len(data.rstrip())), offset


def _frame_rate(frame_time: str) -> float:
    """Frames per second: the usual rate whose inverse the file states, rounded or cut off (.0083333 is 120), or 1/t."""
    seconds = float(frame_time)
    mantissa, _, exponent = frame_time.lower().partition("e")
    if len(exponent) > _LONGEST_EXPONENT:
        return 1 / seconds
    last_digit = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
    for rate in _USUAL_RATES:
        if abs(rate * seconds - 1) < 0.015 and -last_digit / 2 <= 1 / rate - seconds < last_digit:
            return rate
    return 1 / seconds


def _meant_rate(source: Source, line: int, frame_time: str) -> tuple[float, str]:
    """Frames per second where the frame time is a rate, or milliseconds, and not both; and what it was taken for.

    Raises:
        FileError: it is neither, or either.
    """
    number = float(frame_time)
    as_rate = next((rate for rate in _USUAL_RATES if abs(number - rate) < _NEAR * rate), None)
    as_time = next((rate for rate in _USUAL_RATES if abs(number * rate - 1e3) < _NEAR * 1e3), None)
    said = f"line {line} gives a frame time of {shown(frame_time)} s"
    if as_rate is not None and as_time is None:
        return as_rate, f"{said}: taken for {as_rate:.6g} frames per second"
    if as_time is not None and as_rate is None:
        return as_time, f"{said}: taken for milliseconds, {as_time:.6g} frames per second"
    either = "" if as_rate is None else f": is it a rate, or {as_time:.6g} frames per second in milliseconds?"
    raise source.error(
        line,
        f"Frame Time: {shown(frame_time)} s is no motion's, which has {SLOWEST:g} to {FASTEST:g} frames per "
        f"second{either}; give the rate by hand (--rate)",
    )


def _parse_numbers(source: Source, body: int, starts: NDArray[np.int64]) -> FloatArray:
    """All numbers of the rows, one for each word, whose starts are given relative to `body`."""
    with warnings.catch_warnings():
        # Where the text isn't a list of numbers, numpy warns (or, later, raises) and stops; the count shows it as well.
        warnings.simplefilter("ignore", DeprecationWarning)
        try:
            values = np.fromstring(source.data[body:], dtype=np.float64, sep=" ")
        except ValueError:
            values = np.empty(0)
    if len(values) == len(starts) and np.all(np.abs(values) <= LARGEST_NUMBER):
        return values
    one_by_one = []
    for start, word in zip(starts, source.data[body:].split(), strict=False):
        text = word.decode(errors="replace")
        number = parse_number(text)
        if number is None:
            raise source.error(source.line_at(body + start), why_no_number(text))
        one_by_one.append(number)
    return np.array(one_by_one)


def _check_rows(source: Source, body: int, starts: NDArray[np.int64], frames: int, columns: int) -> None:
    """Every frame must end where a line ends, and the last one at the end of the file."""
    line_ends = np.flatnonzero(np.frombuffer(source.data, dtype=np.uint8, offset=body) == ord("\n"))
    words_so_far = np.append(np.searchsorted(starts, line_ends), len(starts))
    whole = len(starts) // columns
    expected = np.arange(1, min(frames, whole) + 1) * columns
    misplaced = np.flatnonzero(~np.isin(expected, words_so_far))
    if len(misplaced):
        frame = int(misplaced[0])
        first = frame * columns
        ends = np.unique(words_so_far[words_so_far > first])
        # Lines up to the first that brings the frame to its full length.
        values = int(ends[np.searchsorted(ends, first + columns)]) - first
        short = int(ends[0]) - first
        found = short if short < columns and values > columns else values
        line = source.line_at(body + int(starts[first]))
        raise source.error(line, f"frame {frame} has {found} values, but the channels add up to {columns}")
    if whole < frames or len(starts) > frames * columns:
        found = f"{whole} whole frames" + (f" and {len(starts) % columns} values" if len(starts) % columns else "")
        last = body + int(starts[frames * columns]) if len(starts) > frames * columns else len(source.data.rstrip())
        raise source.error(source.line_at(last), f"the file declares {frames} frames and holds {found}")
