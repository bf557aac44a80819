"""What a command line asks for of a motion and of who makes it, and both read."""

import os
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

import motions
from motions.amass.reader import is_amass
from motions.arrays import array_names
from motions.bodies.roles import ROLES
from motions.errors import FileError, UnknownNameError, UserError, ValueRangeError
from motions.gltf import document as gltf
from motions.loading import require_ways
from skeleton import RobotMotion, Skeleton, load_configurations
from skeleton.known_robots import find_urdf
from skeleton.robot.configurations import SUFFIXES

MOST_FPS = 60.0  # where none is asked for
NO_MOTIONS = {
    ".toml": "a scene file, which cape replay --scene reads",
    ".rrd": "a recording, which cape render draws and the Rerun viewer plays",
}
"""What files are that come from this program and hold no motion, by their suffixes."""
Motion = TypeVar("Motion", motions.Clip, RobotMotion)


@dataclass(frozen=True)
class Reading:
    """A motion, or a script to join several, and how to read them, as asked on the command line."""

    clip: str | None
    unit: str | None = None
    up: str | None = None
    height: float | None = None
    start: float | None = None
    end: float | None = None
    fps: float | None = None
    attach: tuple[str, ...] = ()
    script: str | None = None
    skeleton: str | None = None
    rate: float | None = None
    packages: tuple[Path, ...] = ()
    animation: str | None = None

    @property
    def configuration_file(self) -> Path | None:
        """The file of a robot's configurations, None where the motion is something else."""
        if self.clip is None or self.script is not None or Path(self.clip).suffix.lower() not in SUFFIXES:
            return None
        return None if is_amass(Path(self.clip)) else Path(self.clip)

    @property
    def files(self) -> tuple[str | Path | None, ...]:
        """What is read, as far as it is files: with what they name as their textures, and a script's clips."""
        clips = [self.clip]
        with suppress(UserError):  # which is told where it is read
            clips += [step.clip for step in motions.parse_script(self.script or "")]
        given = [*clips, self.skeleton, self.animation]
        return *given, *(file for each in given if each is not None for file in _named_by(each))

    def or_walk(self) -> "Reading":
        """The same, of the walk that comes along where there is neither a clip nor a script."""
        return replace(self, clip="walk") if self.clip is None and self.script is None else self

    @property
    def frame_rate(self) -> float | None:
        """The frames per second that were asked for.

        Raises:
            ValueRangeError: they are out of range.
        """
        if self.fps is not None and not 0.0 < self.fps <= 1000.0:
            raise ValueRangeError(f"fps must be above 0 and at most 1000, not {self.fps}")
        return self.fps

    def check(self) -> None:
        """Check what can be told wrong before a motion is read.

        Raises:
            UserError: a number is out of range, or a name is not known.
        """
        require_ways(unit=_unit(self.unit), up=self.up, height=self.height, rate=self.rate)
        _ = self.frame_rate
        start = 0.0 if self.start is None else self.start
        if not 0.0 <= start <= (np.inf if self.end is None else self.end):
            until = "" if self.end is None else f" to {self.end:g} s"
            raise ValueRangeError(f"can't take a motion from {start:g} s{until}")
        for role in self._roles or ():
            if role not in ROLES:
                raise UnknownNameError("role", role, ROLES)
        if self.skeleton is not None:
            find_urdf(self.skeleton, self.packages)

    def load_as_is(self) -> motions.Clip:
        """Read the clip, or play the script, all of it at its own frame rate.

        Raises:
            UserError: there are both a clip and a script, or neither.
        """
        if self.script is None:
            if self.clip is None:
                raise UserError("give a CLIP or a --script")
            if (path := self.configuration_file) is not None:
                if "take" in array_names(path):
                    raise FileError(f"{self.clip} is no motion, but a kept take, which cape export reads")
                raise UserError(f"{self.clip} holds a robot's configurations: name the robot, such as --skeleton g1")
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
        path = Path(clip)
        if (what := NO_MOTIONS.get(path.suffix.lower())) is not None and os.path.isfile(path):
            raise FileError(f"{clip} is no motion, but {what}")
        return motions.load(
            clip,
            unit=_unit(self.unit),
            up=self.up,
            height=self.height,
            name=name,
            rate=self.rate,
            animation=self.animation,
        )

    def load(self) -> motions.Clip:
        """Read, trim and resample the clip.

        Raises:
            ValueRangeError: it has a single frame.
        """
        clip = self.load_as_is()
        clip = self._trimmed(clip)
        fps = self.frame_rate or min(clip.fps, MOST_FPS)
        clip = clip if fps == clip.fps else clip.resample(fps)
        if clip.frames < 2:
            raise ValueRangeError(f"{clip.name} has a single frame: a motion needs at least two")
        return clip

    def _trimmed(self, whole: Motion) -> Motion:
        """A motion from the start to the end that were asked for; what is beyond its own end is told, and left out."""
        if self.start is None and self.end is None:
            return whole
        trimmed = whole.trim(
            0.0 if self.start is None else self.start,
            whole.duration if self.end is None else min(self.end, whole.duration),
        )
        if self.end is None or self.end <= whole.duration:
            return trimmed
        told = f"end: {self.end:g} s is beyond the motion, which lasts {whole.duration:g} s: it is taken to its end"
        return replace(trimmed, decisions=(*trimmed.decisions, told))

    @property
    def _roles(self) -> dict[str, str] | None:
        return named_pairs(self.attach, "--attach", "ROLE=BONE") or None

    def body(self, clip: motions.Clip) -> Skeleton:
        """The body that a clip moves, with roles named by hand where asked."""
        return Skeleton.from_clip(clip, roles=self._roles)

    def robot(self, urdf: str) -> Skeleton:
        """A robot, with roles named by hand where asked."""
        # The up axis is that of the file with the motion; a clip is turned as it is read.
        up = None if self.configuration_file is None else self.up
        return Skeleton.from_urdf(urdf, roles=self._roles, up=up, package_dirs=self.packages)

    def configurations(self, path: Path, robot: Skeleton) -> RobotMotion:
        """A robot's motion from a file, trimmed.

        Raises:
            ValueRangeError: it has a single frame.
        """
        motion = self._trimmed(load_configurations(path, robot, fps=self.rate))
        if motion.frames < 2:
            raise ValueRangeError(f"{motion.name} has a single frame: a motion needs at least two")
        return motion


def _named_by(file: str) -> tuple[Path, ...]:
    """What a character's file has beside it, as textures; nothing where it is no such file, or can't be read."""
    if Path(file).suffix.lower() not in gltf.SUFFIXES:
        return ()
    try:
        return gltf.Document.read(Path(file)).beside
    except (UserError, TypeError):
        return ()


def _unit(text: str | None) -> str | float | None:
    if text is None:
        return None
    try:
        return float(text)
    except ValueError:
        return text


def named_pairs(pairs: tuple[str, ...], option: str, names: str) -> dict[str, str]:
    """What an option that may be repeated names, by what for.

    Args:
        pairs: as they were given, "A=B" each.
        option: what it is called, for an error's text.
        names: what it takes, such as "ROLE=BONE".

    Raises:
        UserError: one of them is no such pair.
    """
    found = {}
    for pair in pairs:
        first, equals, second = pair.partition("=")
        if not equals or not first or not second:
            raise UserError(f"{option} takes {names}, not {pair!r}")
        found[first] = second
    return found
