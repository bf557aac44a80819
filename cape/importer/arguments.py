"""What the viewer tells an importer besides the file."""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True)
class Arguments:
    """How a recording is to be called.

    Attributes:
        application_id: under which the viewer keeps the layout.
        recording_id: which the viewer shares among importers; None for one of its own.
        ignored: options that ask for what a motion in a cape can't give, in words.
    """

    application_id: str
    recording_id: str | None
    ignored: tuple[str, ...]


def parse(options: Sequence[str], *, name: str) -> Arguments:
    """Read the options of Rerun's importers; those of other versions of it are passed over.

    Args:
        options: all that follows the file's path.
        name: of the motion, which is the application's where none is given.
    """
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False, exit_on_error=False)
    parser.add_argument("--application-id", default=name)
    parser.add_argument("--recording-id")
    # The recording that is on the screen: importers may add to it, but a motion begins one of its own.
    parser.add_argument("--opened-application-id")
    parser.add_argument("--opened-recording-id")
    parser.add_argument("--entity-path-prefix")
    parser.add_argument("--static", action="store_true")
    given, _ = parser.parse_known_args(list(options))
    ignored = []
    if given.entity_path_prefix:
        ignored.append(f"--entity-path-prefix {given.entity_path_prefix}: entities keep their paths below /world")
    if given.static:
        ignored.append("--static: a motion has a time for each of its frames")
    return Arguments(given.application_id, given.recording_id, tuple(ignored))
