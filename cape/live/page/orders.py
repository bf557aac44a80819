"""What the page asks for, as lines of JSON: the only ones that there are, each with numbers and names alone; and what
it begins with."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import TYPE_CHECKING

WIDTH = 160  # columns of the line at most

if TYPE_CHECKING:
    from cape.live.live import Live
    from cape.live.rig import Rig


def beginning_of(rig: Rig, fabric: str) -> str:
    """What the page's controls stand at as a run begins, as JSON; the name of its fabric is empty for one without."""
    wind = (0.0, 0.0, 0.0) if rig.wind is None else rig.wind.velocity
    return json.dumps({
        "wind": [float(part) for part in wind],
        "fabric": fabric,
        "solver": rig.solver.name,
        "self_contact": rig.scene.self_contact is not None,
    })  # fmt: skip


def state_of(live: Live) -> str:
    """What the page shows of a run, as JSON: what its controls stand at, and a line."""
    changes, wind = live.changes, live.wind
    return json.dumps({
        "wind": None if wind is None else [float(part) for part in wind.velocity],
        "fabric": changes.fabric,
        "solver": changes.coming.name,
        "self_contact": changes.self_contact,
        "speed": live.speed,
        "paused": live.paused,
        "line": live.status.line(WIDTH),
    })  # fmt: skip


def orders_of(live: Live) -> dict[str, Callable[..., object]]:
    """What can be asked of a run, by name."""
    changes = live.changes
    return {
        "grab": lambda vertex: changes.take_hold(int(vertex)),
        "reach": lambda vertex, x, y, z: changes.reach(int(vertex), (float(x), float(y), float(z))),
        "let_go": lambda vertex: changes.let_go(int(vertex)),
        "move": lambda bone, x, y, z: changes.move(str(bone), (float(x), float(y), float(z))),
        "wind": lambda x, y, z: changes.set_wind((float(x), float(y), float(z))),
        "fabric": lambda name: changes.set_fabric(str(name)),
        "solver": lambda name: changes.set_solver(str(name)),
        "substeps": lambda factor: changes.set_substeps(float(factor)),
        "self_contact": lambda on: changes.set_self_contact(bool(on)),
        "speed": lambda speed: live.set_speed(float(speed)),
        "pause": lambda on: live.pause(bool(on)),
        "tear": changes.tear,
        "reset": changes.reset,
    }


def obey(live: Live, line: str) -> None:
    """Do what a line asks for; one that makes no sense is told."""
    try:
        name, *values = json.loads(line)
        orders_of(live)[name](*values)
    except (ValueError, TypeError, KeyError, RecursionError):
        live.say(f"the page asked for something unknown: {line.strip()[:60]}")
