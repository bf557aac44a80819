"""The contacts of a run, frame by frame."""

import numpy as np

from cape.measure.contact_points import ContactPoints
from cape.results.kept import IN_MEMORY, Kept


class KeptContacts:
    """Contacts of frames, added one after the other."""

    def __init__(self, *, in_memory: int = IN_MEMORY) -> None:
        """Nothing is kept yet; of each of their arrays so many bytes stay in memory."""
        self._starts = [0]
        self._points, self._normals = (Kept((3,), np.float32, in_memory=in_memory) for _ in range(2))
        self._depths = Kept((), np.float32, in_memory=in_memory)
        self._colliders, self._vertices = (Kept((), np.int32, in_memory=in_memory) for _ in range(2))

    @property
    def size(self) -> int:
        """How much they are [bytes]."""
        kept = (self._points, self._normals, self._depths, self._colliders, self._vertices)
        return sum(each.size for each in kept)

    def add(self, contacts: ContactPoints) -> None:
        """Add the contacts of a frame."""
        self._points.add(contacts.points)
        self._normals.add(contacts.normals)
        self._depths.add(contacts.depths)
        self._colliders.add(contacts.colliders)
        self._vertices.add(contacts.vertices)
        self._starts.append(self._starts[-1] + len(contacts.points))

    def cut(self, frames: int) -> None:
        """Keep those of no more than so many of the first frames."""
        del self._starts[frames + 1 :]
        for kept in (self._points, self._normals, self._depths, self._colliders, self._vertices):
            kept.cut(self._starts[-1])

    def all(self, frames: int, first: int = 0) -> ContactPoints:
        """Those of so many of the first frames, or of these from one on."""
        starts = np.array(self._starts[first : frames + 1])
        kept = (self._points, self._normals, self._depths, self._colliders, self._vertices)
        return ContactPoints(starts - starts[0], *(each.array()[starts[0] : starts[-1]] for each in kept))
