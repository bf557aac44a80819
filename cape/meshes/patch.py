"""A triangle mesh whose edges can be split, collapsed and turned: each vertex knows its triangles."""

import numpy as np
from numpy.typing import NDArray

from cape.cloth.triangle_mesh import edges_of

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
Edge = tuple[int, int]

CORNER = np.cos(np.radians(40.0))  # of the turn of a border, from which on its vertex stays
BENT = 0.3  # cosine between normals of a triangle before and after, at least
INNER, AT_BORDER = 6, 4  # neighbours of a vertex at best


class Patch:
    """A mesh with an area in each triangle, two of them at most at an edge, all turned alike."""

    def __init__(self, positions: FloatArray, triangles: IntArray) -> None:
        """Take vertices [m], (V, 3), and triangles, (T, 3)."""
        self._points: list[FloatArray] = list(positions.copy())
        self._faces: dict[int, tuple[int, int, int]] = dict(enumerate(map(tuple, triangles.tolist())))
        self._of: list[set[int]] = [set() for _ in self._points]
        for number, face in self._faces.items():
            for vertex in face:
                self._of[vertex].add(number)
        self._next = len(self._faces)
        edges = edges_of(triangles)
        rim = edges.vertices[edges.triangles == 1]
        self._border: set[int] = set(rim.ravel().tolist())
        self._fixed = _corners(positions, rim)

    def arrays(self) -> tuple[FloatArray, IntArray]:
        """Vertices [m], (V, 3), and triangles, (T, 3)."""
        triangles = np.array(list(self._faces.values()), dtype=np.int64)
        used, numbered = np.unique(triangles, return_inverse=True)
        return np.array(self._points)[used], numbered.reshape(-1, 3)

    def split(self, longest: float) -> None:
        """Split edges in the middle until none is longer [m]."""
        waiting = self._edges()
        while waiting:
            again: list[Edge] = []
            lengths = self._lengths(waiting)
            for k in np.argsort(-lengths, kind="stable")[: np.count_nonzero(lengths > longest)]:
                again += self._split(*waiting[k])
            waiting = sorted(set(again))

    def collapse(self, shortest: float, longest: float) -> None:
        """Collapse edges shorter than a length where that makes none longer than another [m], and folds nothing."""
        edges = self._edges()
        lengths = self._lengths(edges)
        for k in np.argsort(lengths, kind="stable")[: np.count_nonzero(lengths < shortest)]:
            a, b = edges[k]
            if self._shared(a, b) and np.linalg.norm(self._points[a] - self._points[b]) < shortest:
                self._collapse(a, b, longest)

    def turn(self) -> None:
        """Turn edges to the other diagonal where that brings the number of neighbours nearer to the best."""
        for a, b in self._edges():
            shared = sorted(self._shared(a, b))
            if len(shared) == 2:
                self._turn(a, b, shared[0], shared[1])

    def _edges(self) -> list[Edge]:
        triangles = np.array(list(self._faces.values()), dtype=np.int64)
        return [(a, b) for a, b in edges_of(triangles).vertices.tolist()]

    def _lengths(self, edges: list[Edge]) -> FloatArray:
        ends = np.array(self._points)[np.array(edges)]
        return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)

    def _shared(self, a: int, b: int) -> set[int]:
        """Triangles that both vertices have."""
        return self._of[a] & self._of[b]

    def _neighbours(self, vertex: int) -> set[int]:
        return {v for number in self._of[vertex] for v in self._faces[number]} - {vertex}

    def _normal(self, face: tuple[int, ...]) -> FloatArray:
        """Normal of a triangle, twice its area long [m2]."""
        a, b, c = (self._points[vertex] for vertex in face)
        p, q = b - a, c - a
        return np.array([p[1] * q[2] - p[2] * q[1], p[2] * q[0] - p[0] * q[2], p[0] * q[1] - p[1] * q[0]])

    def _put(self, number: int, face: tuple[int, int, int]) -> None:
        """Set a triangle, new or known."""
        for vertex in self._faces.get(number, ()):
            self._of[vertex].discard(number)
        self._faces[number] = face
        for vertex in face:
            self._of[vertex].add(number)

    def _split(self, a: int, b: int) -> list[Edge]:
        """Split an edge; gives those that are new, or shorter than they were."""
        shared = sorted(self._shared(a, b))
        if not shared:
            return []
        middle = len(self._points)
        self._points.append((self._points[a] + self._points[b]) / 2.0)
        self._of.append(set())
        if len(shared) == 1:
            self._border.add(middle)
        new = [(a, middle), (b, middle)]
        for number in shared:
            face = self._faces[number]
            self._put(number, _with(face, b, middle))
            self._put(self._next, _with(face, a, middle))
            self._next += 1
            new += [(vertex, middle) for vertex in face if vertex not in (a, b)]
        return new

    def _collapse(self, a: int, b: int, longest: float) -> None:
        """Draw an edge together, to the end that must stay where one must."""
        shared = self._shared(a, b)
        both = a in self._border and b in self._border
        if (both and len(shared) != 1) or (a in self._fixed and b in self._fixed):
            return
        if len(self._neighbours(a) & self._neighbours(b)) != len(shared):
            return  # the surface would touch itself
        if b in self._fixed or (b in self._border and a not in self._border):
            a, b = b, a
        stays = a in self._fixed or (a in self._border and b not in self._border)
        place = self._points[a] if stays else (self._points[a] + self._points[b]) / 2.0
        around = [self._points[v] for v in (self._neighbours(a) | self._neighbours(b)) - {a, b}]
        if not around or np.linalg.norm(np.array(around) - place, axis=1).max() > longest:
            return
        kept = sorted((self._of[a] | self._of[b]) - shared)
        before = [self._normal(self._faces[number]) for number in kept]
        old = self._points[a], self._points[b]
        self._points[a] = self._points[b] = place
        if not all(_agree(n, self._normal(self._faces[k])) for n, k in zip(before, kept, strict=True)) or not kept:
            self._points[a], self._points[b] = old
            return
        for number in shared:
            for vertex in self._faces.pop(number):
                self._of[vertex].discard(number)
        for number in sorted(self._of[b]):
            self._put(number, _with(self._faces[number], b, a))

    def _turn(self, a: int, b: int, first: int, second: int) -> None:
        """Turn the edge between two triangles where that helps."""
        c, d = (next(v for v in self._faces[k] if v not in (a, b)) for k in (first, second))
        ends = (a, b, c, d)
        off = [len(self._neighbours(v)) - (AT_BORDER if v in self._border else INNER) for v in ends]
        change = (-1, -1, 1, 1)
        if sum((o + s) ** 2 for o, s in zip(off, change, strict=True)) >= sum(o * o for o in off):
            return
        if self._shared(c, d) or c == d:
            return
        face = self._faces[first]
        if face[(face.index(a) + 1) % 3] != b:
            a, b = b, a  # so that the first goes a, b, c and the second b, a, d
        turned = ((a, d, c), (d, b, c))
        before = self._normal(face) + self._normal(self._faces[second])
        if all(_agree(before, self._normal(each)) for each in turned):
            self._put(first, turned[0])
            self._put(second, turned[1])


def _with(face: tuple[int, int, int], old: int, new: int) -> tuple[int, int, int]:
    """A triangle with another vertex in the place of one."""
    a, b, c = (new if vertex == old else vertex for vertex in face)
    return a, b, c


def _agree(before: FloatArray, after: FloatArray) -> bool:
    """Whether a triangle keeps an area and faces as it did."""
    return bool(before @ after > BENT * np.sqrt((before @ before) * (after @ after))) and bool(after.any())


def _corners(positions: FloatArray, rim: IntArray) -> set[int]:
    """Vertices at which a border turns, ends or meets another one."""
    beside: dict[int, list[int]] = {}
    for a, b in rim.tolist():
        beside.setdefault(a, []).append(b)
        beside.setdefault(b, []).append(a)
    fixed = set()
    for vertex, others in beside.items():
        if len(others) == 2:
            p, q = positions[vertex] - positions[others[0]], positions[others[1]] - positions[vertex]
            if p @ q >= CORNER * np.sqrt((p @ p) * (q @ q)):
                continue
        fixed.add(vertex)
    return fixed
