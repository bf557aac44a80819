"""The process between the physics and a viewer: it takes the newest frame, and may wait for the viewer as it likes.

It is told of frames by a byte each on its standard input, and ends when that is closed, however the physics ended.
"""

from __future__ import annotations

import os
import pickle
import sys
import uuid
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from cape.live.feed.mailbox import LiveFrame, Mailbox
from cape.record.moments import MomentRecording, Shown

if TYPE_CHECKING:
    import rerun as rr

NICER = 2
PATIENCE = 0.25  # [s] to wait at a time for a frame to be on its way
TICK = "0.004"  # [s] after which Rerun hands on what it was given


def main(folder: Path, url: str) -> NoReturn:
    """Send what comes into the mailbox of a folder to the viewer at a URL, until standard input is closed."""
    import rerun as rr

    os.environ["RERUN_FLUSH_TICK_SECS"] = TICK
    box = Mailbox.open(folder / "frames")
    stream: rr.RecordingStream | None = None
    recording: MomentRecording | None = None
    shown: Shown | None = None
    setup = -1
    for frame in arriving(box):
        begins = shown is None or frame.setup != setup
        if shown is None or begins:
            newer = read_setup(folder, frame.setup)
            if newer is None:
                continue
            shown, setup = newer, frame.setup
        track = shown.track(frame.time, frame.bone_positions, frame.rotations_wxyz, frame.morphs)
        if stream is None or recording is None:
            stream = rr.RecordingStream(f"cape live {shown.name}", recording_id=uuid.uuid4())
            recording = MomentRecording(stream)
            blueprint = recording.begin(shown, track)
            stream.connect_grpc(url, default_blueprint=blueprint)
            stream.send_recording_name(shown.name)
        elif begins:
            recording.begin(shown, track)
        recording.add(frame.number, track, frame.positions)
        _wait_for(stream, folder)
    # Each frame has been waited for; Rerun's own end would wait once more, without end where a viewer does not read.
    tidy(folder)
    os._exit(0)


def arriving(box: Mailbox) -> Iterator[LiveFrame]:
    """The newest frame of a mailbox, whenever there is one, until standard input is closed.

    A frame has been sent when the next one is asked for.
    """
    while True:
        frame = box.take()
        if frame is None:
            if not os.read(0, 65536):
                return
            continue
        yield frame
        if box.sent < 0:
            _give_way()  # only now: to begin takes long enough where viewers draw on all cores
        box.sent = frame.number


def _give_way() -> None:
    """Let who computes go before this process, and this one before a viewer that draws in software."""
    with suppress(OSError, AttributeError):
        os.nice(NICER)


def _wait_for(stream: rr.RecordingStream, folder: Path) -> None:
    """Wait until what was given is on its way: what waits here is one frame, and the newest comes next."""
    while True:
        try:
            stream.flush(timeout_sec=PATIENCE)
            return
        except Exception:  # the viewer has not read yet, or is gone; whoever started this process sees that
            if _is_over():
                tidy(folder)
                os._exit(0)


def _is_over() -> bool:
    """Tell whether standard input is closed: then nobody waits for what is on its way."""
    import select

    return bool(select.select([0], [], [], PATIENCE)[0]) and not os.read(0, 65536)


def tidy(folder: Path) -> None:
    """Take away what both processes share once the run is over, and the folder if there is nothing else in it.

    A run that was killed can't do so itself.
    """
    with suppress(OSError):
        for shared in (folder / "frames", *folder.glob("setup-*")):
            shared.unlink(missing_ok=True)
        folder.rmdir()


def write_setup(folder: Path, number: int, shown: Shown) -> None:
    """Hand over what the frames of a set-up have in common; both processes are this program."""
    partial = folder / f"setup-{number}.part"
    partial.write_bytes(pickle.dumps(shown))
    partial.replace(folder / f"setup-{number}")


def read_setup(folder: Path, number: int) -> Shown | None:
    """What was handed over; None where it has been taken away, since several newer ones are there."""
    try:
        return pickle.loads((folder / f"setup-{number}").read_bytes())
    except FileNotFoundError:
        return None


__all__ = ["LiveFrame", "main", "read_setup", "tidy", "write_setup"]

if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
