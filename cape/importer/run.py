"""From a file that the viewer opened to a recording on standard output."""

import sys
import warnings
from collections.abc import Sequence
from os.path import splitext
from pathlib import Path
from typing import TYPE_CHECKING

from cape.cli.character import read_character
from cape.cli.reading import Reading
from cape.importer.arguments import parse
from cape.importer.output import NOTES, Viewer, end_with_viewer, keep_from_text
from cape.reach import reach_of
from cape.results.so_far import SoFar
from cape.run.simulate import simulate
from cape.scene.dress import dress
from motions.errors import UserError
from motions.files import text_of

if TYPE_CHECKING:
    import rerun as rr

TOGETHER = 8  # frames that are sent at once, after the first: an eighth of the messages


def run(path: str, motion: str, options: Sequence[str]) -> int:
    """Write the recording of a character in a cape to standard output, as its frames are computed.

    Whatever was decided, or went wrong, is a line on `/notes`. A robot is drawn on `/world/robot`; the viewer's own
    importer of URDF draws it elsewhere in the same recording, where no view of the layout looks.

    Args:
        path: of a BVH, or of a robot's URDF or motion.
        motion: the same BVH, or the file with the robot's motion.
        options: what else the viewer says (`cape.importer.arguments`).

    Returns:
        The status to exit with: 0, or 2 for a mistake in the file, which is told on standard error as well, since the
        viewer shows that of an importer that fails.
    """
    import rerun as rr

    keep_from_text()
    end_with_viewer()
    given = parse(options, name=text_of(Path(path).stem))
    stream = rr.RecordingStream(given.application_id, recording_id=given.recording_id)
    stream.send_recording_name(text_of(Path(path).stem))
    viewer = Viewer(stream)
    try:
        with warnings.catch_warnings():
            warnings.showwarning = lambda message, *_, **__: viewer.note(str(message), level="WARN")
            for text in given.ignored:
                viewer.note(f"left out: {text}", level="WARN")
            _play(Reading(motion, skeleton=_robot_of(path)), stream, viewer)
        viewer.close()
    except Exception as error:
        viewer.note(f"{Path(path).name}: {error}", level="ERROR")
        viewer.close()
        if not isinstance(error, UserError):
            raise
        print(f"cape: {error}", file=sys.stderr)
        return 2
    return 0


def _robot_of(path: str) -> str | None:
    """The URDF that a file is, or stands beside; None for a BVH."""
    stem, suffix = splitext(path)
    if suffix.lower() == ".bvh":
        return None
    return path if suffix.lower() == ".urdf" else f"{stem}.urdf"


def _play(reading: Reading, stream: "rr.RecordingStream", viewer: Viewer) -> None:
    """Read, dress, simulate, send.

    Raises:
        UserError: the motion can't be read, or can't wear a cape.
    """
    from cape.record.growing import GrowingRecording

    who = read_character(reading)
    for decision in who.decisions:
        viewer.note(decision)
    scene = dress(who.body, who.track, colliders=who.hitboxes.solids)
    left_out = reach_of(scene, who.track).left_out
    recording = GrowingRecording(stream, scene, who.track, left_out=left_out, surfaces=who.surfaces, notes=NOTES)
    for name, reason in left_out.items():
        viewer.note(f"left out: {name}, {reason}")
    viewer.open(recording.blueprint)
    viewer.flush()

    run: list[SoFar] = []

    def send(done: int, so_far: SoFar) -> None:
        run[:] = [so_far]
        if done % TOGETHER == 1:
            recording.add(done, so_far)
            viewer.flush()

    take = simulate(scene, who.track, name=who.name, on_frame=send)
    recording.add(len(take.positions), *run)
    last = len(take.positions) - 1
    for text in take.warnings:
        viewer.note(text, level="WARN", frame=last, time=float(take.bones.times[last]))
    viewer.flush()
