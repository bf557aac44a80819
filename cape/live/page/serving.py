"""The process that serves the page: it takes the newest frame as a viewer does, and prints what is asked for.

A browser that is slow, or many, cost the physics nothing.
"""

from __future__ import annotations

import json
import sys
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cape.live.feed.mailbox import Mailbox
from cape.live.feed.sending import arriving, read_setup, tidy
from cape.live.page.controls import add_controls
from cape.live.page.grips import Grips
from cape.live.page.stage import Stage

SHOWN_EACH = 2  # frames: 30 a second are enough for a hand
_LINE = threading.Lock()  # drags and frames come from different threads


def main(folder: Path, host: str, port: int, begins: Mapping[str, Any]) -> int:
    """Serve until standard input is closed; `begins` is what the controls stand at."""
    import viser

    server = viser.ViserServer(host=host, port=port, label="cape", verbose=False)
    # The server takes another port where this one is not free.
    _say("serving", server.get_port())
    stage = Stage(server, Grips(_say))
    controls, told = add_controls(server.gui, begins, _say), b""
    box = Mailbox.open(folder / "frames")
    for frame in arriving(box):
        if frame.told != told:
            told = frame.told
            controls.follow(json.loads(told))
        if frame.setup != stage.setup:
            if (shown := read_setup(folder, frame.setup)) is None:
                continue
            stage.begin(shown, frame)
        if frame.number % SHOWN_EACH == 0:
            stage.show(frame)
    tidy(folder)
    return 0


def _say(name: str, *values: Any) -> None:
    line = json.dumps([name, *values]) + "\n"
    with _LINE:
        sys.stdout.write(line)
        sys.stdout.flush()


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), sys.argv[2], int(sys.argv[3]), json.loads("".join(sys.argv[4:]) or "{}")))
