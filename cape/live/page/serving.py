"""The process that serves the page: it takes the newest frame as a viewer does, and prints what is asked for.

A browser that is slow, or many, cost the physics nothing.
"""

from __future__ import annotations

import json
import sys
import threading
from pathlib import Path
from typing import Any

from cape.cloth.fabrics import FABRICS
from cape.live.feed.mailbox import Mailbox
from cape.live.feed.sending import arriving, read_setup
from cape.live.page.grips import Grips
from cape.live.page.stage import Stage, in_turn
from cape.solvers import SOLVERS

SHOWN_EACH = 2  # frames: 30 a second are enough for a hand
FASTEST_WIND = 12.0  # [m/s] on the sliders
_LINE = threading.Lock()  # drags and frames come from different threads


def main(folder: Path, host: str, port: int) -> int:
    """Serve until standard input is closed."""
    import viser

    server = viser.ViserServer(host=host, port=port, label="cape", verbose=False)
    # The server takes another port where this one is not free.
    _say("serving", server.get_port())
    stage = Stage(server, Grips(_say))
    _add_controls(server.gui)
    box = Mailbox.open(folder / "frames")
    for frame in arriving(box):
        if frame.setup != stage.setup:
            stage.begin(read_setup(folder, frame.setup), frame)
        if frame.number % SHOWN_EACH == 0:
            stage.show(frame)
    return 0


def _say(name: str, *values: Any) -> None:
    line = json.dumps([name, *values]) + "\n"
    with _LINE:
        sys.stdout.write(line)
        sys.stdout.flush()


def _add_controls(gui: Any) -> None:
    gui.add_markdown("Drag the cloth with the left button; elsewhere it turns the view.")
    wind = [gui.add_slider(f"wind {axis} [m/s]", -FASTEST_WIND, FASTEST_WIND, 0.5, 0.0) for axis in "xyz"]
    for slider in wind:
        slider.on_update(in_turn(lambda _: _say("wind", *(float(each.value) for each in wind))))
    fabric = gui.add_dropdown("fabric", list(FABRICS), initial_value="cape")
    fabric.on_update(in_turn(lambda _: _say("fabric", fabric.value)))
    solver = gui.add_dropdown("solver", list(SOLVERS))
    solver.on_update(in_turn(lambda _: _say("solver", solver.value)))
    substeps = gui.add_button_group("substeps", ["fewer", "more"])
    substeps.on_click(in_turn(lambda _: _say("substeps", 0.8 if substeps.value == "fewer" else 1.25)))
    contact = gui.add_checkbox("self-contact", True)
    contact.on_update(in_turn(lambda _: _say("self_contact", bool(contact.value))))
    speed = gui.add_slider("speed", 0.0625, 1.0, 0.0625, 1.0)
    speed.on_update(in_turn(lambda _: _say("speed", float(speed.value))))
    paused = gui.add_checkbox("paused", False)
    paused.on_update(in_turn(lambda _: _say("pause", bool(paused.value))))
    gui.add_button("tear").on_click(in_turn(lambda _: _say("tear")))
    gui.add_button("put on anew").on_click(in_turn(lambda _: _say("reset")))


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])))
