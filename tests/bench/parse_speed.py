"""How fast BVH files are read, in megabytes of text a second: parsed alone, and loaded with all that is then decided.

    python -m tests.bench.parse_speed [FILE.bvh ...]

Without files it takes the shipped clips, and the real ones of the folder CAPE_CLIPS where it is set. Each file is read
as it is and with its frames repeated to about 15 MB; the best of twenty runs (three of the long one) counts.
"""

import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import motions
from motions.bvh import reader

LONG = 15e6  # bytes


def megabytes_per_second(path: Path, read: Callable[[Path], object], *, runs: int) -> float:
    """The best of some readings."""
    seconds = []
    for _ in range(runs):
        start = time.perf_counter()
        read(path)
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
    print(f"{'file':32} {'kB':>6} {'parse':>6} {'load':>6} {'load, 15 MB':>12}")
    with tempfile.TemporaryDirectory() as folder:
        for path in files:
            long = repeat(path, Path(folder))
            parsed = megabytes_per_second(path, reader.read, runs=20)
            loaded = megabytes_per_second(path, motions.load, runs=20)
            long_loaded = megabytes_per_second(long, motions.load, runs=3)
            print(f"{path.name:32} {path.stat().st_size / 1e3:6.0f} {parsed:6.0f} {loaded:6.0f} {long_loaded:12.0f}")
            long.unlink()


if __name__ == "__main__":
    main()
