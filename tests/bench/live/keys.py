"""How soon a key is answered by the motion that is recorded, through a real terminal.

`python -m tests.bench.live.keys [--presses 60] [--ahead]` runs `cape live -o` at 60 frames a second in a
pseudo-terminal, with the default cape on a character that stands, and presses the key that turns it, at any moment
between two frames. It tells in how many frames the motion has answered, 1 where the first one that began after the key
turned already, and how long after the key that one began [ms]; and what share of real time the run kept. `--ahead` is
for a machine that others use as well.
"""

import argparse
import json
import os
import tempfile
import time
from collections import Counter
from pathlib import Path

import numpy as np

import cape
from tests.bench.live.__main__ import get_ahead, q
from tests.support.machine.terminal import READY, answers, stamped, terminal

APART = 0.4  # s between two keys, in which a turn is over
PHASES = 0.0167  # s, over which keys are spread


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--presses", type=int, default=60)
    parser.add_argument("--ahead", action="store_true", help="before all else on this machine (Linux, root)")
    asked = parser.parse_args()
    if asked.ahead:
        get_ahead()
    pressed, rng = [], np.random.default_rng(0)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        with terminal("-o", "run.npz", "--json", folder=folder, command=stamped()) as run:
            run.wait_for(READY)
            run.reach(60)
            for _ in range(asked.presses):
                pressed.append(run.press("\x1b[D"))
                time.sleep(APART + PHASES * rng.random())
            run.press("q")
            run.ended()
        found = answers(cape.Take.load(folder / "run.npz"), folder / "stamps", pressed)
    frames, seconds = zip(*found, strict=True)
    after = 1e3 * np.array(seconds)
    told = {
        "presses": len(found),
        "frames": dict(sorted(Counter(frames).items())),
        "after_ms": {"median": q(after, 0.5), "p90": q(after, 0.9), "most": q(after, 1.0)},
        "realtime_factor": json.loads(run.printed)["realtime_factor"],
        "load": os.getloadavg()[0],
    }
    print(json.dumps(told))


if __name__ == "__main__":
    main()
