"""The controls beside the picture: what the keyboard changes of a run."""

from collections.abc import Callable, Mapping
from typing import Any

from cape.cloth.fabrics import FABRICS
from cape.live.page.stage import in_turn
from cape.solvers import SOLVERS

FASTEST_WIND = 12.0  # [m/s] on the sliders, or what blows at first, where that is more
OWN = "its own"  # what a fabric or a solver without a name is called, which can be left, and not come back to


def add_controls(gui: Any, begins: Mapping[str, Any], say: Callable[..., object]) -> None:
    """Add them to viser's `gui`, standing at what the run begins with; `say` takes an order and what belongs to it."""
    gui.add_markdown("Drag the cloth with the left button; elsewhere it turns the view.")
    blows = begins.get("wind", (0.0, 0.0, 0.0))
    most = max(FASTEST_WIND, *map(abs, blows))
    wind = [gui.add_slider(f"wind {axis} [m/s]", -most, most, 0.5, v) for axis, v in zip("xyz", blows, strict=True)]
    for slider in wind:
        slider.on_update(in_turn(lambda _: say("wind", *(float(each.value) for each in wind))))
    for name, known, usual in (("fabric", FABRICS, "cape"), ("solver", SOLVERS, "euler")):
        _add_choice(gui, name, list(known), begins.get(name, usual), say)
    substeps = gui.add_button_group("substeps", ["fewer", "more"])
    substeps.on_click(in_turn(lambda _: say("substeps", 0.8 if substeps.value == "fewer" else 1.25)))
    contact = gui.add_checkbox("self-contact", bool(begins.get("self_contact", True)))
    contact.on_update(in_turn(lambda _: say("self_contact", bool(contact.value))))
    speed = gui.add_slider("speed", 0.0625, 1.0, 0.0625, 1.0)
    speed.on_update(in_turn(lambda _: say("speed", float(speed.value))))
    paused = gui.add_checkbox("paused", False)
    paused.on_update(in_turn(lambda _: say("pause", bool(paused.value))))
    gui.add_button("tear").on_click(in_turn(lambda _: say("tear")))
    gui.add_button("put on anew").on_click(in_turn(lambda _: say("reset")))


def _add_choice(gui: Any, name: str, known: list[str], now: str, say: Callable[..., object]) -> None:
    """Have one of what is known chosen."""
    now = now if now in known else OWN
    choice = gui.add_dropdown(name, known if now in known else [OWN, *known], initial_value=now)
    choice.on_update(in_turn(lambda _: choice.value == OWN or say(name, choice.value)))
