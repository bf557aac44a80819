"""`rerun-importer-cape`: what the Rerun viewer calls, as any `rerun-importer-*` on the path, for each file it opens.

Whether a file is one to put a cape on is told by its name and its first bytes before anything is imported.
"""

import os
import sys

NOT_OURS = 66  # rerun.EXTERNAL_IMPORTER_INCOMPATIBLE_EXIT_CODE
MOTION_SUFFIXES = (".csv", ".npz")  # skeleton.robot.configurations.SUFFIXES
HEAD = 65536  # bytes that are looked at: comments may stand before a robot


def main() -> None:
    """Put a cape on a file that is meant for it, on standard output; exits with 66 for any other."""
    path = sys.argv[1] if len(sys.argv) > 1 else ""
    motion = motion_of(path)
    if motion is None:
        sys.exit(NOT_OURS)
    from cape.importer import run

    sys.exit(run(path, motion, sys.argv[2:]))


def motion_of(path: str) -> str | None:
    """The file with the motion: a BVH, or a robot's, beside a URDF of the same name; None for other files."""
    stem, suffix = os.path.splitext(path)
    suffix = suffix.lower()
    if suffix == ".bvh":
        # What may stand before the first word: a mark of the order of bytes, and blanks.
        return path if _head(path).lstrip(b"\xef\xbb\xbf \t\r\n").upper().startswith(b"HIERARCHY") else None
    if suffix == ".urdf" and b"<robot" in _head(path):
        beside = (stem + ending for ending in MOTION_SUFFIXES)
        return next((file for file in beside if os.path.isfile(file)), None)
    # The viewer keeps a URDF to its own importer, and calls no other: what can be opened there is the motion.
    if suffix in MOTION_SUFFIXES and b"<robot" in _head(stem + ".urdf"):
        return path if os.path.isfile(path) else None
    return None


def _head(path: str) -> bytes:
    try:
        with open(path, "rb") as file:
            return file.read(HEAD)
    except OSError:
        return b""


if __name__ == "__main__":
    main()
