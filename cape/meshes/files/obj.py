"""Wavefront OBJ: positions, texture coordinates and polygons, with a map for each object (o) and group (g).

Read here rather than by trimesh, which drops `o` and `g`, and merges vertices so that they can't be found again.
"""

from itertools import pairwise

import numpy as np

from cape.meshes.source import FloatArray, Source, add_weight, upright
from motions.errors import FileError


def read_obj(data: bytes, label: str, *, up: str = "y") -> Source:
    """The mesh in an OBJ file; polygons are split into fans of triangles.

    A vertex stands once for each texture coordinate that it has.

    Args:
        data: the file's bytes.
        label: what errors call the file.
        up: its up axis, "y" or "z".

    Raises:
        FileError: a line can't be read, or names a vertex that there is not.
        UnknownNameError: there is no such up axis.
    """
    reader = _Reader()
    text = data.decode("utf-8", errors="replace").replace("\\\r\n", " ").replace("\\\n", " ")
    for number, line in enumerate(text.splitlines(), 1):
        words = line.split("#", 1)[0].split()
        if words:
            try:
                reader.take(words[0], words[1:])
            except (ValueError, IndexError) as error:
                raise FileError(f"{label}, line {number}: can't read {line.strip()[:60]!r}: {error}") from None
    return reader.mesh(label, up)


class _Reader:
    """What has been read so far."""

    def __init__(self) -> None:
        self._points: list[list[float]] = []
        self._places: list[list[float]] = []
        self._corners: dict[tuple[int, int], int] = {}
        self._triangles: list[tuple[int, int, int]] = []
        self._names: list[str] = []
        self._members: dict[str, set[int]] = {}
        self._object: str | None = None
        self._groups: list[str] = []

    def take(self, keyword: str, values: list[str]) -> None:
        """Read a line."""
        if keyword == "v":
            self._points.append([float(values[axis]) for axis in range(3)])
        elif keyword == "vt":
            self._places.append([float(values[0]), float(values[1]) if len(values) > 1 else 0.0])
        elif keyword == "o":
            self._object = " ".join(values) or None
        elif keyword == "g":
            self._groups = values
        elif keyword == "f":
            corners = [self._corner(value) for value in values]
            if len(corners) < 3:
                raise ValueError(f"a face has three corners at least, not {len(corners)}")
            self._triangles += [(corners[0], *pair) for pair in pairwise(corners[1:])]
            for name in (self._object, *self._groups):
                if name is not None:
                    self._members.setdefault(name, set()).update(corners)

    def _corner(self, value: str) -> int:
        """The vertex of a corner such as 3, 3/1 or 3/1/2."""
        parts = value.split("/")
        point = _index(parts[0], len(self._points), "vertices")
        place = _index(parts[1], len(self._places), "texture coordinates") if len(parts) > 1 and parts[1] else -1
        return self._corners.setdefault((point, place), len(self._corners))

    def mesh(self, label: str, up: str) -> Source:
        """All of it.

        Raises:
            FileError: there is no face.
        """
        if not self._triangles:
            raise FileError(f"{label} has no face")
        # In the order of the file, rather than of its faces.
        corners = np.array(list(self._corners), dtype=np.int64)
        order = np.lexsort((corners[:, 1], corners[:, 0]))
        corners, number = corners[order], np.argsort(order)
        weights: dict[str, FloatArray] = {}
        for name, members in self._members.items():
            add_weight(weights, name, number[list(members)], 1.0, len(corners))
        uv = None
        if (corners[:, 1] >= 0).all():
            uv = np.array(self._places)[corners[:, 1]]
            uv[:, 1] = 1.0 - uv[:, 1]
        positions = upright(np.array(self._points)[corners[:, 0]], up)
        return Source(positions, number[np.array(self._triangles, dtype=np.int64)], uv, weights)


def _index(text: str, count: int, what: str) -> int:
    """A number from 1, or from the last backwards, as one from 0."""
    number = int(text)
    index = number - 1 if number > 0 else count + number
    if number == 0 or not 0 <= index < count:
        raise ValueError(f"there is no {text} among {count} {what} so far")
    return index
