"""What a batch consists of: a task for each clip and each combination of swept options, with a name of its own."""

import hashlib
import os
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from motions.errors import FileError, UserError

FOLDER_OF = (".bvh", ".glb", ".gltf", ".vrm")  # what is taken of a folder
LONGEST_NAME = 150  # bytes: file systems take 255


@dataclass(frozen=True)
class Task:
    """One run of `cape replay`; texts alone, so that it can be sent to another machine.

    Attributes:
        name: of the task and of its folder.
        clip: as `cape replay` takes it.
        arguments: other arguments of `cape replay`.
        swept: the swept options among them.
        folder: of the batch, absolute.
        suffix: of what the run is to write.
        place: the folder in which paths among the arguments begin, absolute.
        inputs: digests of the files that are read, by path.
        version: of cape, which other machines need as well.
    """

    name: str
    clip: str
    arguments: tuple[str, ...]
    folder: str
    suffix: str
    place: str
    version: str
    swept: Mapping[str, str] = field(default_factory=dict)
    inputs: Mapping[str, str] = field(default_factory=dict)

    @property
    def own_folder(self) -> Path:
        """Where everything of the task is."""
        return Path(self.folder, self.name)

    @property
    def output(self) -> Path:
        """What the run writes."""
        return self.own_folder / f"{self.name}{self.suffix}"


def clips_of(asked: Iterable[str]) -> list[str]:
    """The clips that are meant: a folder's are those in it and in the folders within, in their order; each once.

    Raises:
        FileError: there are none in a folder, or it can't be read.
    """
    found: list[str] = []
    for clip in asked:
        if not os.path.isdir(clip):
            found.append(clip)
            continue
        inside = sorted(path for path in Path(clip).rglob("*") if path.suffix.lower() in FOLDER_OF and path.is_file())
        if not inside:
            raise FileError(f"no motion ({', '.join(FOLDER_OF)}) is in the folder {clip}")
        found += map(str, inside)
    return list({_absolute(clip) or clip: clip for clip in found}.values())


def names_of(clips: Sequence[str], swept: Sequence[Mapping[str, str]]) -> list[list[str]]:
    """A name for each clip and each combination: as much of the clip's path as tells it from others, and the values."""
    parts = [_parts(clip) for clip in clips]
    depth = [1] * len(clips)
    while True:
        stems = [_plain("_".join(own[-d:])) for own, d in zip(parts, depth, strict=True)]
        # File systems that do not tell small letters from capitals would mix folders up.
        count = Counter(stem.casefold() for stem in stems)
        short = [k for k, stem in enumerate(stems) if count[stem.casefold()] > 1 and depth[k] < len(parts[k])]
        if not short:
            break
        for k in short:
            depth[k] += 1
    taken: set[str] = set()
    return [[_free("_".join([stem, *_values(chosen)]), taken) for chosen in swept] for stem in stems]


def digest(path: Path) -> str:
    """What tells a file's content from others.

    Raises:
        UserError: it can't be read.
    """
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        raise UserError(f"can't read {path}: {error.strerror}") from error


def _values(chosen: Mapping[str, str]) -> list[str]:
    return [f"{name}={_plain(Path(value).name)}" for name, value in chosen.items()]


def _free(name: str, taken: set[str]) -> str:
    name, number = name.encode()[:LONGEST_NAME].decode(errors="ignore"), 1
    free = name
    while free.casefold() in taken:
        number += 1
        free = f"{name}_{number}"
    taken.add(free.casefold())
    return free


def _parts(clip: str) -> tuple[str, ...]:
    path = Path(_absolute(clip) or clip)
    return (*path.parent.parts, path.stem)


def _absolute(clip: str) -> str | None:
    return os.path.abspath(clip) if os.path.exists(clip) else None


def _plain(text: str) -> str:
    """A text as a part of a file's name on any system."""
    return re.sub(r"[^\w.,=+-]+", "-", text).strip("-.") or "clip"
