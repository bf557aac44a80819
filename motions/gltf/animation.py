"""Animations of a glTF file (3.11) and what their keyframes give at any time (appendix C)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.errors import FileError, UnknownNameError
from motions.gltf.accessors import values_of
from motions.gltf.document import Document
from motions.gltf.nodes import Nodes, unit
from motions.limits import FASTEST

FloatArray = NDArray[np.float64]

WIDTHS = {"translation": 3, "rotation": 4, "scale": 3}
USUAL_FPS = 60.0  # of keyframes that don't follow each other evenly
SLOWEST_KEYS = 12.0  # per second: fewer are poses to go between, and no frames
_ROUNDING = 1e-5  # [s] by which a time in single precision may be off after a minute
_EVEN = 0.05  # of a frame, by which keyframes of a frame rate may be off it


@dataclass(frozen=True, eq=False)
class Channel:
    """Keyframes of one part of one node's transform, or of the weights of its mesh's morph targets.

    Attributes:
        node: which one.
        path: "translation", "rotation" (w, x, y, z), "scale" or "weights".
        times: of the K keyframes [s], increasing, shape (K,).
        values: at the keyframes, shape (K, n), of splines (K, 3, n): tangent into it, value, tangent out of it.
        way: "STEP", "LINEAR" or "CUBICSPLINE".
    """

    node: int
    path: str
    times: FloatArray
    values: FloatArray
    way: str

    def at(self, times: FloatArray) -> FloatArray:
        """Values at F times, before the first keyframe and after the last those of these, shape (F, n)."""
        keys = self.values[:, 1] if self.way == "CUBICSPLINE" else self.values
        if self.way == "STEP" or len(self.times) == 1:
            return keys[np.clip(np.searchsorted(self.times, times + _ROUNDING, "right") - 1, 0, None)]
        before = np.clip(np.searchsorted(self.times, times, "right") - 1, 0, len(self.times) - 2)
        step = self.times[before + 1] - self.times[before]
        share = np.clip((times - self.times[before]) / step, 0.0, 1.0)
        if self.way == "LINEAR":
            if self.path == "rotation":
                return quaternions.slerp(keys[before], keys[before + 1], share)
            return keys[before] + share[:, None] * (keys[before + 1] - keys[before])
        t, step = share[:, None], step[:, None]
        found = (
            (2 * t**3 - 3 * t**2 + 1) * keys[before]
            + step * (t**3 - 2 * t**2 + t) * self.values[before, 2]
            + (3 * t**2 - 2 * t**3) * keys[before + 1]
            + step * (t**3 - t**2) * self.values[before + 1, 0]
        )
        return unit(found) if self.path == "rotation" else found


def animation_names(document: Document) -> tuple[str, ...]:
    """Names of all animations, those without one by their numbers."""
    return tuple(str(each.get("name") or f"animation {k}") for k, each in enumerate(document.list_of("animations")))


def find_animation(document: Document, asked: str | None, *, moving: Sequence[int]) -> tuple[int | None, list[str]]:
    """The number of the animation that is meant, None where there is none, and what had to be decided.

    Args:
        document: the file.
        asked: its name; None for the first that moves what matters.
        moving: the nodes that matter.

    Raises:
        UnknownNameError: there is none of that name; lists those that there are.
    """
    names = animation_names(document)
    if asked is not None:
        if asked not in names:
            raise UnknownNameError("animation", asked, names)
        return names.index(asked), []
    matter = set(moving)
    fitting = [
        number
        for number, each in enumerate(document.list_of("animations"))
        if any(channel.get("target", {}).get("node") in matter for channel in each["channels"])
    ]
    if len(fitting) < 2:
        return (fitting[0] if fitting else None), []
    listed = ", ".join(names[number] for number in fitting)
    return fitting[0], [f"animation: {names[fitting[0]]}, the first of {listed}; name another by animation"]


def channels_of(document: Document, number: int, nodes: Sequence[int]) -> list[Channel]:
    """Keyframes of an animation that move some nodes.

    Raises:
        FileError: they are not as they should be.
    """
    animation, found = document.list_of("animations")[number], []
    for channel in animation["channels"]:
        node, path = channel["target"].get("node"), channel["target"]["path"]
        if node not in nodes or path not in WIDTHS:
            continue
        found.append(_keyframes(document, animation, channel, WIDTHS[path]))
    return found


def weights_of(document: Document, number: int, targets: Mapping[int, int]) -> list[Channel]:
    """Keyframes of an animation that weigh morph targets.

    Args:
        document: the file.
        number: of the animation.
        targets: how many each node has that has any.

    Raises:
        FileError: they are not as they should be.
    """
    animation = document.list_of("animations")[number]
    return [
        _keyframes(document, animation, channel, targets[channel["target"]["node"]])
        for channel in animation["channels"]
        if channel["target"]["path"] == "weights" and channel["target"].get("node") in targets
    ]


def _keyframes(document: Document, animation: dict[str, Any], channel: dict[str, Any], width: int) -> Channel:
    """The keyframes of a channel, of so many numbers each."""
    node, path = channel["target"]["node"], channel["target"]["path"]
    sampler, what = animation["samplers"][channel["sampler"]], f"keyframes of node {node}"
    times = values_of(document, sampler["input"], of="SCALAR", what=what).ravel()
    values, way = values_of(document, sampler["output"], what=what), sampler.get("interpolation", "LINEAR")
    rows = 3 if way == "CUBICSPLINE" else 1
    if path == "weights" and values.size == rows * len(times) * width:  # told one by one
        values = values.reshape(-1, width)
    if way not in ("STEP", "LINEAR", "CUBICSPLINE") or values.shape != (rows * len(times), width):
        raise FileError(f"{document.label}: {what} have {len(times)} times for {len(values)} values of {way}")
    if (np.diff(times) <= 0.0).any():
        # Keys that rounding has put on one time are no reason to refuse a file.
        times = np.asarray(np.maximum.accumulate(times), dtype=np.float64) + 1e-9 * np.arange(len(times))
    if path == "rotation":
        values = np.roll(values, 1, axis=1)
        values = values if rows == 3 else unit(values)
    return Channel(node, path, times, values.reshape(-1, 3, width) if rows == 3 else values, way)


def frame_times(channels: Sequence[Channel], rate: float | None) -> tuple[FloatArray, float]:
    """Times of frames from the first keyframe to the last [s], shape (F,), and how many there are in a second.

    Args:
        channels: one at least.
        rate: frames per second; None for those of the keyframes where they follow each other evenly, else 60.

    Raises:
        FileError: there would be more frames than a motion has.
    """
    keys = np.unique(np.concatenate([channel.times for channel in channels]))
    fps = rate or _rate_of(keys)
    count = int((keys[-1] - keys[0]) * fps + _EVEN) + 1
    return keys[0] + np.arange(count) / fps, fps


def _rate_of(keys: FloatArray) -> float:
    gaps = np.diff(keys)
    gaps = gaps[gaps > 10 * _ROUNDING]
    if len(gaps):
        rate = 1.0 / float(np.median(gaps))
        for fps in (round(rate), rate):
            frames = (keys - keys[0]) * fps
            if SLOWEST_KEYS <= fps <= FASTEST and np.abs(frames - np.rint(frames)).max() < _EVEN:
                return float(fps)
    return USUAL_FPS


def sampled(nodes: Nodes, channels: Sequence[Channel], times: FloatArray) -> dict[str, FloatArray]:
    """Translations (F, N, 3), rotations wxyz (F, N, 4) and scales (F, N, 3) of all nodes at F times."""
    still = {"translation": nodes.translations, "rotation": nodes.rotations_wxyz, "scale": nodes.scales}
    found = {path: np.repeat(values[None], len(times), axis=0) for path, values in still.items()}
    for channel in channels:
        found[channel.path][:, channel.node] = channel.at(times)
    return found
