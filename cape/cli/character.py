"""From what the command line names to a body and its motion."""

import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import motions
from motions.errors import FileError, UserError, ValueRangeError
from skeleton import BoneTrack, Skeleton

MOST_FPS = 60.0  # where none is asked for


@dataclass(frozen=True)
class Reading:
    """A clip, or a script to join several, and how to read them, as asked on the command line."""

    clip: str | None
    unit: str | None = None
    up: str | None = None
    height: float | None = None
    start: float | None = None
    end: float | None = None
    fps: float | None = None
    attach: tuple[str, ...] = ()
    script: str | None = None

    def load_as_is(self) -> motions.Clip:
        """Read the clip, or play the script, all of it at its own frame rate.

        Raises:
            UserError: there are both a clip and a script, or neither.
        """
        if self.script is None:
            if self.clip is None:
                raise UserError("give a CLIP or a --script")
            return self._read(self.clip)
        if self.clip is not None:
            raise UserError(f"give either CLIP ({self.clip}) or --script, not both")
        steps = motions.parse_script(self.script)
        clips: dict[str, motions.Clip] = {}
        for number, step in enumerate(steps, 1):
            try:
                clips[step.clip] = clips.get(step.clip) or self._read(step.clip, name=step.clip)
            except UserError as error:
                raise UserError(f"part {number} of the script, {str(step)!r}: {error}") from None
        return motions.MotionGraph(list(clips.values())).play(steps)

    def _read(self, clip: str, name: str | None = None) -> motions.Clip:
        return motions.load(clip, unit=_unit(self.unit), up=self.up, height=self.height, name=name)

    def load(self) -> motions.Clip:
        """Read, trim and resample the clip."""
        clip = self.load_as_is()
        if self.start is not None or self.end is not None:
            clip = clip.trim(0.0 if self.start is None else self.start, clip.duration if self.end is None else self.end)
        fps = self.fps or min(clip.fps, MOST_FPS)
        if self.fps is not None and not 0.0 < self.fps <= 1000.0:
            raise ValueRangeError(f"fps must be above 0 and at most 1000, not {self.fps}")
        return clip if fps == clip.fps else clip.resample(fps)

    def body(self, clip: motions.Clip) -> Skeleton:
        """Build the skeleton, with roles named by hand where asked."""
        return Skeleton.from_clip(clip, roles=_roles(self.attach))

    def character(self) -> tuple[motions.Clip, Skeleton, BoneTrack]:
        """Clip, skeleton, and the motion of all of its bones.

        Raises:
            ValueRangeError: the clip has a single frame.
        """
        clip = self.load()
        if clip.frames < 2:
            raise ValueRangeError(f"{clip.name} has a single frame: a motion needs at least two")
        body = self.body(clip)
        return clip, body, body.track(clip)


def output_path(asked: Path | None, clip: motions.Clip, suffix: str = "") -> Path:
    """Where to write, checked before anything is computed.

    Raises:
        FileError: the folder does not exist or can't be written, or the path is a folder.
    """
    path = Path(f"{clip.name}{suffix}.rrd") if asked is None else asked
    folder = path.resolve().parent
    if path.is_dir():
        raise FileError(f"can't write {path}: it is a directory")
    if not folder.is_dir():
        raise FileError(f"can't write {path}: there is no folder {folder}")
    if not os.access(folder, os.W_OK):
        raise FileError(f"can't write {path}: the folder {folder} is not writable")
    return path


def open_viewer(path: Path) -> None:
    """Open a recording in the Rerun viewer, which goes on after this command ends and listens on loopback alone."""
    subprocess.Popen(
        [sys.executable, "-m", "rerun", str(path), "--bind", "127.0.0.1"],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )


def _unit(text: str | None) -> str | float | None:
    if text is None:
        return None
    try:
        return float(text)
    except ValueError:
        return text


def _roles(pairs: tuple[str, ...]) -> dict[str, str] | None:
    roles = {}
    for pair in pairs:
        role, equals, bone = pair.partition("=")
        if not equals or not role or not bone:
            raise UserError(f"--attach takes ROLE=BONE, not {pair!r}")
        roles[role] = bone
    return roles or None
