"""How evenly a live run steps, and how much memory it takes, whatever its viewer does.

`python -m tests.bench.live [--seconds 300] [--case NAME] [--ahead]` runs the default cape at 60 frames a second with a
viewer that

    reads       takes all that comes and draws nothing
    draws       draws in software, on both cores, as fast as it can (needs Vulkan: apt-get install mesa-vulkan-drivers)
    stopped     reads for a while, and is then stopped (SIGSTOP)
    killed      reads for a while, and is then killed
    recorded    reads, while all frames are kept
    busy        reads, while twice as many processes as there are cores compute in the middle third of the time
    nothing     for comparison: no run at all, but a loop that waits for its next turn as often, and how many steps of
                12 ms would have ended late that began when it did

and tells, by case: how late steps began (median, 99th percentile, most) and how long they took; how many ended late
that had begun late and taken less than 12 ms; the memory of the physics and the sender from 30 s on (or a fifth of the
time); the share of real time; what was given up from when on [s]; by how much the cape's threads were strained, looked
at every second (median, 90th percentile, most); and how busy the machine was. `--ahead` is for a
machine that others use as well.
"""

import argparse
import json
import os
import signal
import subprocess
import sys
import threading
import time
from contextlib import suppress
from typing import Any

import numpy as np

import cape
import motions
import skeleton
from cape.assembly.springs import springs_of
from cape.live.character import CharacterSource
from cape.live.feed.sender import be_nice
from cape.live.feed.viewers import LOOPBACK, free_port, program
from cape.live.pace.pacing import Pacer

CASES = ("nothing", "reads", "draws", "stopped", "killed", "recorded", "busy")
QUICK = 0.012  # s, of a step that has no excuse to end late


def viewer(port: int, *, draws: bool) -> subprocess.Popen[bytes]:
    ways = ["--headless", "--hide-welcome-screen", "--renderer", "vulkan"] if draws else ["--test-receive"]
    process = subprocess.Popen(
        [program(), "--bind", LOOPBACK, "--port", str(port), "--memory-limit", "1GB", *ways],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    be_nice(process.pid)  # as the one that `cape live` starts
    time.sleep(5.0 if draws else 2.0)
    return process


def draw_on(port: int, over: threading.Event) -> None:
    """Have a viewer draw one picture after the other, in a process of its own."""
    script = (
        "import sys\nfrom rerun.experimental import ViewerClient\n"
        f"client = ViewerClient.connect('rerun+http://{LOOPBACK}:{port}/proxy')\n"
        "while True:\n"
        "    for view in client.get_state().views:\n"
        "        if view.name == 'cape': client.take_screenshot(view.view_id)\n"  # the other is a tab away
    )
    process = subprocess.Popen([sys.executable, "-c", script], stderr=subprocess.DEVNULL)
    over.wait()
    process.kill()
    process.wait()


def keep_busy() -> list[subprocess.Popen[bytes]]:
    """Begin twice as many processes that compute as there are cores, for as long as this one lives."""
    script = "import os\nparent = os.getppid()\nwhile os.getppid() == parent: pass"
    return [subprocess.Popen([sys.executable, "-c", script]) for _ in range(2 * (os.cpu_count() or 1))]


def end_all(processes: list[subprocess.Popen[bytes]]) -> list[subprocess.Popen[bytes]]:
    """End processes; gives those that are left, which are none."""
    for process in processes:
        process.kill()
        process.wait()
    return []


def memory(process: int) -> float:
    """Resident [MB], also what is shared: a library's pages are a process's own once no other one has it loaded."""
    with suppress(OSError), open(f"/proc/{process}/smaps_rollup") as file:
        rows = dict(line.split(":", 1) for line in file.read().splitlines()[1:])
        return float(rows["Rss"].split()[0]) / 1e3
    return 0.0


def nothing(seconds: float) -> dict[str, Any]:
    """How late a loop wakes up that does nothing else: what the machine itself adds."""
    pacer, over, steps = Pacer(1.0 / 60.0), threading.Event(), []
    pacer.begin()
    while len(steps) < 60.0 * seconds:
        pacer.wait(over)
        steps.append(pacer.done())
    late = 1e3 * np.array(steps)[60:, 0]
    told = {"median": q(late, 0.5), "p99": q(late, 0.99), "most": q(late, 1.0)}
    return {
        "case": "nothing", "seconds": seconds, "steps": len(late), "late_ms": told,
        "late_though_quick": int((late > 1e3 / 60.0 - 1e3 * QUICK).sum()), "load": os.getloadavg()[0],
    }  # fmt: skip


def run(case: str, seconds: float) -> dict[str, Any]:
    clips = [motions.load(name) for name in ("idle", "walk", "run", "kick", "jump", "spin")]
    body = skeleton.Skeleton.from_clip(clips[0])
    scene = cape.dress(body, body.track(clips[0]))
    source = CharacterSource(clips, body, "idle", once=("kick", "jump", "spin"))
    port, over = free_port(), threading.Event()
    process = viewer(port, draws=case == "draws")
    live = cape.Live(
        scene, source, viewer=f"rerun+http://{LOOPBACK}:{port}/proxy", keep=case == "recorded", end_with_viewer=False
    )
    springs = springs_of(scene.cloth)
    held = np.zeros(scene.cloth.vertices, bool)
    held[np.concatenate([each.vertices for each in scene.attachments])] = True
    measured = springs.measured & ~(held[springs.first] & held[springs.second])
    first, second, rest = springs.first[measured], springs.second[measured], springs.rest[measured]
    strains: list[float] = []
    marks: list[tuple[float, float]] = []
    given_up: list[tuple[float, str]] = []
    others: list[subprocess.Popen[bytes]] = []
    try:
        with live:
            live.steps = []
            drawing = threading.Thread(target=draw_on, args=(port, over), daemon=True)
            if case == "draws":
                drawing.start()
            begun, told = time.monotonic(), False
            plan = ["walk", "run", "kick", "walk", "jump", "run", "spin", "idle"]
            while (now := time.monotonic() - begun) < seconds and live.running:
                live.wait(1.0)
                if not given_up or given_up[-1][1] != live.status.given_up:
                    given_up.append((round(now, 1), live.status.given_up))
                if case == "busy" and (1.0 < 3.0 * now / seconds < 2.0) != bool(others):
                    others = end_all(others) if others else keep_busy()
                places = live.positions
                lengths = np.linalg.norm(places[first] - places[second], axis=1)
                strains.append(float((lengths / rest - 1.0).max()))
                marks.append((now, memory(os.getpid()) + memory(live.sender_process)))
                if len(marks) % 5 == 0:
                    source.go(plan[len(marks) // 5 % len(plan)])
                if not told and now > min(10.0, seconds / 6.0) and case in ("stopped", "killed"):
                    process.send_signal(signal.SIGSTOP if case == "stopped" else signal.SIGKILL)
                    told = True
            over.set()
            status, steps = live.status, np.array(live.steps)
    finally:
        over.set()
        end_all([process, *others])
    (late, took), strain = 1e3 * steps[60:].T, np.array(strains)
    settled = [each for at, each in marks if at > min(30.0, seconds / 5.0)]
    slow = (late + took > 1e3 / live.fps) & (took < 1e3 * QUICK) & (late > 1.0)
    return {
        "case": case,
        "seconds": round(status.clock, 1),
        "steps": len(late),
        "late_ms": {"median": q(late, 0.5), "p99": q(late, 0.99), "most": q(late, 1.0)},
        "took_ms": {"median": q(took, 0.5), "p99": q(took, 0.99), "most": q(took, 1.0)},
        "late_though_quick": int(slow.sum()),
        "memory_mb": {"at_30_s": round(settled[0], 1), "grew_by": round(max(settled) - settled[0], 1)},
        "realtime_factor": round(status.time / status.clock, 3),
        "given_up": given_up,
        "strain": {"median": q(strain, 0.5), "p90": q(strain, 0.9), "most": q(strain, 1.0)},
        "load": os.getloadavg()[0],
    }


def get_ahead() -> None:
    """Have this process and those that it starts go before all others, among which time is shared as ever."""
    if os.getpid() != os.getsid(0):
        with suppress(PermissionError):
            os.setsid()
    with open("/proc/self/autogroup", "w") as file:
        file.write("-19")


def q(values: np.ndarray, share: float) -> float:
    return round(float(np.quantile(values, share)), 2)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=300.0)
    parser.add_argument("--case", choices=CASES, action="append")
    parser.add_argument("--ahead", action="store_true", help="before all else on this machine (Linux, root)")
    asked = parser.parse_args()
    if asked.ahead:
        get_ahead()
    for case in asked.case or CASES:
        print(json.dumps(nothing(asked.seconds) if case == "nothing" else run(case, asked.seconds)), flush=True)


if __name__ == "__main__":
    main()
