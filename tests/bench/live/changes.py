"""By how much a step of a live run begins late because something is changed.

`python -m tests.bench.live.changes [--rounds 3] [--spacing S] [--ahead] [--torn]` runs the default cape on a
character that stands, at 60 frames a second and without a viewer, and asks for one change after the other, as keys
do. For each it tells how long it took until the run went on with it [s], and the latest that a step began from the
asking until half a second after that: by how much later than a frame after the one before it [ms]. Where steps are
too long by themselves all begin late: `usual` is what nine of ten are late by before, or after, and `hitch` by how
much more the latest is. `at` tells which step that was, from the one that went on with the change. `nothing` is the
same without a change. The first round may compile. `--torn` tears the cape before all of that. `--ahead` is for a
machine that others use as well, `--keep` keeps all frames, as a recording.
"""

import argparse
import json
import os
import time
from collections.abc import Callable
from typing import Any

import numpy as np

import cape
import motions
import skeleton
from cape.live.character import CharacterSource
from tests.bench.live.__main__ import get_ahead, q

AFTER = 30  # frames that are still looked at
SETTLED = 5  # of them, after which none is late because of the change itself
LONGEST = 120.0  # s that a change may take, with what it compiles


def hem(run: cape.Live) -> np.ndarray:
    """The vertices of its lower edge."""
    return run._rig.first.cloth.region("bottom")


CHANGES: dict[str, tuple[Callable[[cape.Live], None], str]] = {
    "fabric": (lambda run: run.changes.set_fabric("denim"), "fabric denim"),
    "fabric back": (lambda run: run.changes.set_fabric("swim"), "fabric swim"),
    "no self-contact": (lambda run: run.changes.set_self_contact(False), "no self-contact"),
    "self-contact": (lambda run: run.changes.set_self_contact(True), "self-contact"),
    "more substeps": (lambda run: run.changes.set_substeps(1.25), "substeps"),
    "fewer substeps": (lambda run: run.changes.set_substeps(0.8), "substeps"),
    "xpbd": (lambda run: run.changes.set_solver("xpbd"), "solver xpbd"),
    "backward_euler": (lambda run: run.changes.set_solver("backward_euler", substeps=2), "solver backward_euler"),
    "euler": (lambda run: run.changes.set_solver("euler"), "solver euler"),
    "pin": (lambda run: run.changes.pin("bottom"), "bottom pinned"),
    "let go": (lambda run: run.changes.pin("bottom"), "bottom let go"),
    "hand": (lambda run: run.changes.take_hold(int(hem(run)[len(hem(run)) // 2])), "vertex"),
    "hand off": (lambda run: run.changes.let_go(int(hem(run)[len(hem(run)) // 2])), "vertex"),
    "wind": (lambda run: run.changes.set_wind((-3.0, 0.0, 0.0)), "wind"),
    "no wind": (lambda run: run.changes.set_wind((0.0, 0.0, 0.0)), "no wind"),
    "anew": (lambda run: run.changes.reset(), "put on anew"),
}


def dressed(spacing: float | None = None, *, keep: bool = False) -> cape.Live:
    clips = [motions.load(name) for name in ("idle", "walk")]
    body = skeleton.Skeleton.from_clip(clips[0])
    scene = cape.dress(body, body.track(clips[0]), spacing=spacing)
    return cape.Live(scene, CharacterSource(clips, body, "idle"), viewer="none", keep=keep)


def begun_late(live: cape.Live) -> np.ndarray:
    """By how much each step began later than a frame after the one before was due [ms], the first one by nothing."""
    late, took = 1e3 * np.array(live.steps).T
    overdue = np.maximum(late[:-1] + took[:-1] - 1e3 / live.fps, 0.0)
    return np.concatenate([[0.0], late[1:] + overdue])


def wait_for(live: cape.Live, true: Callable[[], bool]) -> None:
    end = time.monotonic() + LONGEST
    while not true() and live.running and time.monotonic() < end:
        time.sleep(0.002)


def one(live: cape.Live, name: str, change: Callable[[cape.Live], None] | None, told: str) -> dict[str, Any]:
    assert live.steps is not None
    live.say("")
    first, begun = len(live.steps), time.monotonic()
    if change is None:
        wait_for(live, lambda: len(live.steps or ()) >= first + 2 * AFTER)
    else:
        change(live)
        wait_for(live, lambda: told in live.status.message)
    took, done = time.monotonic() - begun, len(live.steps)
    wait_for(live, lambda: len(live.steps or ()) >= done + AFTER)
    late, steps = begun_late(live), 1e3 * np.array(live.steps)[:, 1]
    before, after = slice(max(first - AFTER, 0), first), slice(done, done + AFTER)
    usual = max(q(late[before], 0.9), q(late[after][SETTLED:], 0.9))
    most = q(late[first : done + AFTER], 1.0)
    return {
        "change": name,
        "ready_s": round(took, 2),
        "late_ms": most,
        "at": int(np.argmax(late[first : done + AFTER])) + first - done,
        "usual_ms": usual,
        "hitch_ms": round(most - usual, 2),
        "step_ms": [q(steps[before], 0.5), q(steps[after], 0.5)],
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--spacing", type=float, help="of the cape's vertices [m]")
    parser.add_argument("--change", choices=CHANGES, action="append", help="all, in this order, unless told")
    parser.add_argument("--torn", action="store_true")
    parser.add_argument("--keep", action="store_true")
    parser.add_argument("--ahead", action="store_true", help="before all else on this machine (Linux, root)")
    asked = parser.parse_args()
    if asked.ahead:
        get_ahead()
    with dressed(asked.spacing, keep=asked.keep) as live:
        live.steps = []
        if asked.torn:
            live.changes.tear()
        live.wait(2.0)
        vertices = live._rig.scene.cloth.vertices
        hitches: dict[str, list[float]] = {}
        for number in range(1, asked.rounds + 1):
            found = [one(live, "nothing", None, "")]
            found += [one(live, name, *CHANGES[name]) for name in asked.change or CHANGES]
            for each in found:
                print(json.dumps({"round": number, **each}), flush=True)
                hitches.setdefault(each["change"], []).append(each["hitch_ms"])
            print(json.dumps({"round": number, "vertices": vertices, "load": os.getloadavg()[0]}), flush=True)
        told = {name: [q(np.array(values), share) for share in (0.5, 1.0)] for name, values in hitches.items()}
        print(json.dumps({"hitch_ms": "median and most of all rounds", **told}))


if __name__ == "__main__":
    main()
