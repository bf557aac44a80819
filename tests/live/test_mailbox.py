"""The newest frame between two processes: what is taken is whole, and nothing piles up."""

import struct
import sys
import textwrap
from pathlib import Path

import numpy as np

from cape.live.feed.mailbox import SLOTS, LiveFrame, Mailbox
from cape.live.feed.sending import tidy
from tests.support.processes import python

VERTICES, BONES, MORPHS = 50, 3, 5


def frame(number: int, vertices: int = VERTICES) -> LiveFrame:
    """One all of whose numbers are its own."""
    return LiveFrame(
        number,
        number / 60.0,
        number % 7,
        np.full((vertices, 3), number, np.float32),
        np.full((BONES, 3), number, float),
        np.full((BONES, 4), number, float),
        np.full(MORPHS, number, float),
    )


def test_the_newest_frame_is_taken_and_only_once(tmp_path: Path):
    box = Mailbox.create(tmp_path / "frames", VERTICES, BONES, MORPHS)
    other = Mailbox.open(tmp_path / "frames")
    assert other.take() is None
    for number in range(10):
        box.put(frame(number))
    taken = other.take()
    assert taken is not None
    for got, put in zip(taken, frame(9), strict=True):
        np.testing.assert_array_equal(got, put)
    assert other.take() is None
    assert other.sent == -1
    other.sent = 9
    assert box.sent == 9


def test_a_frame_of_fewer_vertices_keeps_its_size(tmp_path: Path):
    box = Mailbox.create(tmp_path / "frames", VERTICES, BONES, MORPHS)
    box.put(frame(1, vertices=20))
    taken = box.take()
    assert taken is not None
    assert taken.positions.shape == (20, 3)


def test_a_frame_that_is_being_written_is_not_taken(tmp_path: Path):
    """As where the writer has come round to a frame while it was copied: its number is then another one."""
    box = Mailbox.create(tmp_path / "frames", VERTICES, BONES, MORPHS)
    box.put(frame(1))
    start = box._start(1)
    reader = Mailbox.open(tmp_path / "frames")
    reader._memory[start : start + 8] = struct.pack("=q", -1)
    looks = []

    def write_over(*_: object) -> bool:
        looks.append(1)
        box.put(frame(2))
        return False

    reader._is_at = write_over  # pyright: ignore[reportAttributeAccessIssue]
    reader._memory[start : start + 8] = struct.pack("=q", 1)
    reader._is_at = lambda at, count: write_over() if not looks else Mailbox._is_at(reader, at, count)  # pyright: ignore[reportAttributeAccessIssue]
    taken = reader.take()
    assert taken is not None
    assert taken.number == 2


def test_frames_taken_by_another_process_are_whole(tmp_path: Path):
    """Thousands are put as fast as possible while another process takes what it can."""
    script = textwrap.dedent(
        """
        import sys
        from pathlib import Path
        import numpy as np
        from cape.live.feed.mailbox import Mailbox
        box, last, seen = Mailbox.open(Path(sys.argv[1])), -1, 0
        print("ready", flush=True)
        while last < 3000:
            frame = box.take()
            if frame is None:
                continue
            assert frame.number > last
            last, seen = frame.number, seen + 1
            for values in (frame.positions, frame.bone_positions, frame.rotations_wxyz):
                assert (values == frame.number).all(), frame.number
        print(seen)
        """
    )
    import subprocess

    box = Mailbox.create(tmp_path / "frames", VERTICES, BONES, MORPHS)
    process = subprocess.Popen(
        [sys.executable, "-c", script, str(tmp_path / "frames")],
        cwd=Path(__file__).parents[2],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "ready\n"
    for number in range(3001):
        box.put(frame(number))
    assert int(process.communicate(timeout=60)[0]) >= 1
    assert process.returncode == 0


def test_memory_is_that_of_a_few_frames(tmp_path: Path):
    box = Mailbox.create(tmp_path / "frames", VERTICES, BONES, MORPHS)
    size = (tmp_path / "frames").stat().st_size
    for number in range(5 * SLOTS):
        box.put(frame(number))
    assert (tmp_path / "frames").stat().st_size == size < (SLOTS + 1) * (VERTICES * 12 + BONES * 56 + 64)


def test_the_sender_needs_no_physics():
    loaded = python(
        "import sys, cape.live.feed.sending; print([m for m in ('numba', 'pinocchio', 'asyncio') if m in sys.modules])"
    )
    assert loaded.strip() == "[]"


def test_what_both_processes_share_is_taken_away_and_nothing_else(tmp_path: Path):
    shared, other = tmp_path / "own", tmp_path / "anybody's"
    for folder in (shared, other):
        folder.mkdir()
        for name in ("frames", "setup-3", "setup-4.part"):
            (folder / name).write_bytes(b"")
    (other / "work.txt").write_text("mine")
    tidy(shared)
    tidy(other)
    assert not shared.exists()
    assert [path.name for path in other.iterdir()] == ["work.txt"]
