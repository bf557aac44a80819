"""`cape hitboxes`: a skeleton and its capsules, to a recording."""

from pathlib import Path

from cape.cli.character import Reading, open_viewer, output_path
from cape.record import save_hitboxes


def run(reading: Reading, *, output: Path | None, spawn: bool) -> int:
    """Record the capsules; gives the exit status."""
    clip, body, track = reading.character()
    path = output_path(output, clip, "_hitboxes")
    capsules = body.capsules()
    save_hitboxes(track, capsules, path, name=f"{clip.name} hitboxes")
    print(f"{len(capsules)} capsules: {', '.join(c.name for c in capsules)}")
    for name, reason in body.capsules_left_out().items():
        print(f"left out {name}: {reason}")
    print(f"recording: {path}")
    if spawn:
        open_viewer(path)
    return 0
