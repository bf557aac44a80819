"""How fast BVH files are read, in megabytes of text a second, with everything that the reader decides.

    python tests/bench/parse_speed.py [FILE.bvh ...]

Without files it takes the shipped clips, and the real ones of the folder CAPE_CLIPS where it is set. Each file is read
as it is and with its frames repeated to about 15 MB; the best of five runs counts.
"""

import os
import sys
import tempfile
import time
from pathlib import Path

import motions

LONG = 15e6  # bytes


def megabytes_per_second(path: Path) -> float:
    """The best of five readings."""
    seconds = []
    for _ in range(5):
        start = time.perf_counter()
        motions.load(path)
        seconds.append(time.perf_counter() - start)
    return path.stat().st_size / min(seconds) / 1e6


def repeat(path: Path, folder: Path) -> Path:
    """A copy whose frames follow one another again and again."""
    head, motion = path.read_text(encoding="utf-8-sig").split("MOTION", 1)
    _, count, time_line, rows = motion.split("\n", 3)
    times = max(1, int(LONG / len(rows)))
    frames = int(count.split(":")[1]) * times
    rows = rows.rstrip() + "\n"
    long = folder / path.name
    long.write_text(f"{head}MOTION\nFrames: {frames}\n{time_line}\n{rows * times}")
    return long


def main() -> None:
    """Print one row a file."""
    files = [Path(argument) for argument in sys.argv[1:]]
    if not files:
        files = [motions.clip_path(name) for name in motions.clip_names()]
        if "CAPE_CLIPS" in os.environ:
            files += sorted(Path(os.environ["CAPE_CLIPS"]).glob("*.bvh"))
    print(f"{'file':32} {'kB':>6} {'MB/s':>6} {'MB/s, 15 MB':>12}")
    with tempfile.TemporaryDirectory() as folder:
        for path in files:
            long = repeat(path, Path(folder))
            speed, long_speed = megabytes_per_second(path), megabytes_per_second(long)
            print(f"{path.name:32} {path.stat().st_size / 1e3:6.0f} {speed:6.0f} {long_speed:12.0f}")
            long.unlink()


if __name__ == "__main__":
    main()
