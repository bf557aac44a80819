"""Clips per minute of `cape batch --jobs 2`, against two shells side by side that call `cape replay` one by one.

    python -m tests.bench.batch [--clips 8] [--rounds 3]

Both do the same clips, in turn. CPU time tells more than wall time where the machine has other things to do. Then what
a clip takes: bytes read and written, and, where there is a Vulkan driver, time for its picture.
"""

import argparse
import json
import os
import resource
import shlex
import subprocess
import tempfile
import time
from pathlib import Path
from statistics import median

import motions
from tests.support.command import CAPE

JOBS = 2


def timed(*commands: str, folder: Path) -> tuple[float, float]:
    """Wall and CPU time of shell commands that run side by side [s]."""
    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.monotonic()
    running = [
        subprocess.Popen(
            ["/bin/sh", "-ec", command],
            cwd=folder,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,  # Linux may share out its cores by sessions, of which a batch has one for each run
        )
        for command in commands
    ]
    assert [process.wait() for process in running] == [0] * len(running)
    wall, after = time.monotonic() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
    return wall, after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def side_by_side(clips: list[str], number: int, folder: Path) -> tuple[float, float]:
    """Replay them in as many shells as there are jobs."""
    commands = [
        "; ".join(f"{shlex.quote(str(CAPE))} replay {clip} -o alone_{number}_{Path(clip).stem}.rrd" for clip in own)
        for own in (clips[k::JOBS] for k in range(JOBS))
    ]
    return timed(*commands, folder=folder)


def batched(clips: list[str], number: int, folder: Path) -> tuple[float, float]:
    """Replay them in a batch."""
    command = [str(CAPE), "batch", *clips, "-o", f"batch_{number}", "--jobs", str(JOBS), "--no-pictures"]
    return timed(shlex.join(command), folder=folder)


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description="Throughput of cape batch")
    parser.add_argument("--clips", type=int, default=8)
    parser.add_argument("--rounds", type=int, default=3)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="cape-bench-") as temporary:
        folder, clips = Path(temporary), []
        for number in range(asked.clips):
            name = motions.clip_names()[number % len(motions.clip_names())]
            clips.append(f"{name}_{number}.bvh")
            (folder / clips[-1]).write_bytes(motions.clip_path(name).read_bytes())
        side_by_side(clips[:JOBS], -1, folder)  # compiles what is missing, and fills the disk's cache
        shares = []
        for number in range(asked.rounds):
            alone, batch = side_by_side(clips, number, folder), batched(clips, number, folder)
            shares.append([a / b for a, b in zip(alone, batch, strict=True)])
            print(f"{asked.clips} clips: side by side {alone[0]:.1f} s ({alone[1]:.1f} s CPU), "
                  f"in a batch {batch[0]:.1f} s ({batch[1]:.1f} s CPU)")  # fmt: skip
        print(f"throughput of a batch: {median(s[0] for s in shares):.3f} by wall time, "
              f"{median(s[1] for s in shares):.3f} by CPU time")  # fmt: skip
        wall, own = batched(clips, 0, folder)
        print(f"a batch in which nothing is left to be done: {wall:.2f} s ({own:.2f} s CPU)")
        runs = json.loads((folder / "batch_0" / "results.json").read_text())["runs"]
        own = [folder / "batch_0" / run["name"] for run in runs]
        read = median(os.path.getsize(folder / clip) for clip in clips)
        written = median(sum(file.stat().st_size for file in each.iterdir()) for each in own)
        taken = median(run["seconds"] / run["facts"]["frames"] * run["facts"]["fps"] for run in runs)
        print(
            f"a clip: {read / 1e3:.0f} kB read, {written / 1e6:.1f} MB written, {taken:.2f} s for each of its seconds"
        )
        command = [str(CAPE), "batch", *clips, "-o", "batch_0", "--jobs", str(JOBS)]
        drawn = timed(shlex.join(command), folder=folder)
        count = sum(
            run["picture"] is not None for run in json.loads((folder / "batch_0/results.json").read_text())["runs"]
        )
        print(f"{count} pictures: {drawn[0]:.1f} s ({drawn[1]:.1f} s CPU)")


if __name__ == "__main__":
    main()
