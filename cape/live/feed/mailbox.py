"""The newest frame, for a process of its own to take: whoever puts one there never waits, and nothing piles up.

It is a file that both have mapped into memory, with room for a few frames that are written in turn. A frame is valid if
its number is the same before and after it was copied: otherwise it has been written over, and a newer one is there.
"""

import mmap
import struct
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

SLOTS = 4  # frames in turn: a reader is late by two before one that it copies is written over
_HEAD = struct.Struct("=8q")  # count of frames put; vertices, bones and, behind the last frame sent, morphs and text
_SLOT = struct.Struct("=7q1d")  # count, number, set-up, vertices, bones, morphs, text; time
_COUNT, _ROOM, _SENT = slice(0, 8), slice(8, 24), slice(24, 32)


class LiveFrame(NamedTuple):
    """What there is to see at a time.

    Attributes:
        number: of the frame.
        time: of the simulation [s].
        setup: number of the set-up that it belongs to: which triangles and colliders there are.
        positions: of the cloth's vertices in the world [m], shape (V, 3).
        bone_positions: origins of the bones in the world [m], shape (B, 3).
        rotations_wxyz: unit quaternions bone_to_world, shape (B, 4).
        morphs: weights of the M morphs of a mesh that the bones move, shape (M,).
        told: what there is to read besides, as UTF-8.
    """

    number: int
    time: float
    setup: int
    positions: NDArray[np.float32]
    bone_positions: FloatArray
    rotations_wxyz: FloatArray
    morphs: FloatArray = np.zeros(0)
    told: bytes = b""


class Mailbox:
    """Room for the newest frame, of so many vertices, bones, morphs and bytes of text at most."""

    def __init__(self, memory: mmap.mmap, vertices: int, bones: int, morphs: int, told: int) -> None:
        """Take memory that `create` or `open` has mapped."""
        self._memory, self.vertices, self.bones, self.morphs, self.told = memory, vertices, bones, morphs, told
        self._taken = 0

    @staticmethod
    def create(path: Path, vertices: int, bones: int, morphs: int = 0, told: int = 0) -> "Mailbox":
        """Make an empty one; the file may vanish once the other process has opened it.

        Raises:
            OSError: there is no room for it.
        """
        with path.open("xb+") as file:
            # Written rather than left as a hole, which could not be filled any more once the disk is full.
            head = _HEAD.pack(0, vertices, bones, -1, morphs, told, 0, 0)
            file.write(head + bytes(SLOTS * _stride(vertices, bones, morphs, told)))
            file.flush()
            return Mailbox(mmap.mmap(file.fileno(), 0), vertices, bones, morphs, told)

    @staticmethod
    def open(path: Path) -> "Mailbox":
        """The one that another process has made.

        Raises:
            OSError: it can't be read.
        """
        with path.open("rb+") as file:
            memory = mmap.mmap(file.fileno(), 0)
        _, vertices, bones, _, morphs, told, *_ = _HEAD.unpack_from(memory)
        return Mailbox(memory, vertices, bones, morphs, told)

    def put(self, frame: LiveFrame) -> None:
        """Have a frame be the newest one."""
        count = self._count + 1
        start = self._start(count)
        sizes = len(frame.positions), len(frame.bone_positions), len(frame.morphs), len(frame.told)
        # Not valid while it is written.
        _SLOT.pack_into(self._memory, start, -1, frame.number, frame.setup, *sizes, frame.time)
        at = start + _SLOT.size
        for values, dtype in _parts(frame):
            data = np.ascontiguousarray(values, dtype)
            self._memory[at : at + data.nbytes] = data.tobytes()
            at += data.nbytes
        self._memory[at : at + len(frame.told)] = frame.told
        self._memory[start : start + 8] = struct.pack("=q", count)
        self._memory[_COUNT] = struct.pack("=q", count)

    def take(self) -> LiveFrame | None:
        """The newest frame, None if it was taken before."""
        while (count := self._count) > self._taken:
            start = self._start(count)
            data = self._memory[start : start + self._stride]
            if struct.unpack_from("=q", data)[0] == count and self._is_at(start, count):
                self._taken = count
                return _unpacked(data)
        return None

    @property
    def sent(self) -> int:
        """Number of the last frame that has gone on to the viewer, -1 for none."""
        return struct.unpack("=q", self._memory[_SENT])[0]

    @sent.setter
    def sent(self, number: int) -> None:
        self._memory[_SENT] = struct.pack("=q", number)

    @property
    def _count(self) -> int:
        return struct.unpack("=q", self._memory[_COUNT])[0]

    def _is_at(self, start: int, count: int) -> bool:
        return struct.unpack("=q", self._memory[start : start + 8])[0] == count

    def _start(self, count: int) -> int:
        return _HEAD.size + count % SLOTS * self._stride

    @property
    def _stride(self) -> int:
        return _stride(self.vertices, self.bones, self.morphs, self.told)


def _stride(vertices: int, bones: int, morphs: int, told: int) -> int:
    """Bytes of a slot."""
    return _SLOT.size + 8 * (-(-(12 * vertices + 56 * bones + 8 * morphs + told) // 8))


def _parts(frame: LiveFrame) -> tuple[tuple[NDArray, type], ...]:
    return (
        (frame.bone_positions, np.float64),
        (frame.rotations_wxyz, np.float64),
        (frame.morphs, np.float64),
        (frame.positions, np.float32),
    )


def _unpacked(data: bytes) -> LiveFrame:
    _, number, setup, vertices, bones, morphs, told, time = _SLOT.unpack_from(data)
    found, at = [], _SLOT.size
    wanted = (bones, 3, np.float64), (bones, 4, np.float64), (morphs, 1, np.float64), (vertices, 3, np.float32)
    for count, width, dtype in wanted:
        found.append(np.frombuffer(data, dtype, count * width, at).reshape(count, width))
        at += found[-1].nbytes
    places, rotations, weights, positions = found
    return LiveFrame(number, time, setup, positions, places, rotations, weights[:, 0], data[at : at + told])
