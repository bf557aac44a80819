"""The controls beside the picture: what the keyboard changes of a run, and a line that tells how it goes."""

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from cape.cloth.fabrics import FABRICS
from cape.live.page.stage import in_turn
from cape.solvers import SOLVERS

FASTEST_WIND = 12.0  # [m/s] on the sliders, or what blows at first, where that is more
OWN = "its own"  # what a fabric or a solver without a name is called, which can be left, and not come back to
QUIET = 1.0  # [s] after somebody has moved a control, from which on it follows the run again


def add_controls(
    gui: Any, begins: Mapping[str, Any], say: Callable[..., object], *, clock: Callable[[], float] = time.monotonic
) -> "Controls":
    """Add them to viser's `gui`, standing at what the run begins with; `say` takes an order and what belongs to it."""
    return Controls(gui, begins, say, clock)


class Controls:
    """Controls that ask for what is chosen, and follow what else changes the run."""

    def __init__(
        self, gui: Any, begins: Mapping[str, Any], say: Callable[..., object], clock: Callable[[], float]
    ) -> None:
        """Add them; see `add_controls`."""
        self._say, self._clock = say, clock
        self._chosen_at: dict[str, float] = {}
        self._set: dict[str, Callable[[Any], None]] = {}
        gui.add_markdown("Drag the cloth with the left button; elsewhere it turns the view.")
        self._line = gui.add_markdown("")
        self._add_wind(gui, begins.get("wind", (0.0, 0.0, 0.0)))
        for name, known, usual in (("fabric", FABRICS, "cape"), ("solver", SOLVERS, "euler")):
            self._add_choice(gui, name, list(known), begins.get(name, usual))
        substeps = gui.add_button_group("substeps", ["fewer", "more"])
        substeps.on_click(in_turn(lambda _: say("substeps", 0.8 if substeps.value == "fewer" else 1.25)))
        contact = gui.add_checkbox("self-contact", bool(begins.get("self_contact", True)))
        self._link("self_contact", contact, lambda: say("self_contact", bool(contact.value)))
        speed = gui.add_slider("speed", 0.0625, 1.0, 0.0625, 1.0)
        self._link("speed", speed, lambda: say("speed", float(speed.value)))
        paused = gui.add_checkbox("paused", False)
        self._link("paused", paused, lambda: say("pause", bool(paused.value)))
        gui.add_button("tear").on_click(in_turn(lambda _: say("tear")))
        gui.add_button("put on anew").on_click(in_turn(lambda _: say("reset")))

    def follow(self, state: Mapping[str, Any]) -> None:
        """Stand at what the run is at, as `orders.state_of` tells, but for what has just been moved here."""
        line = f"`{state['line'].replace('`', '')}`"
        if self._line.content != line:
            self._line.content = line
        for name, put in self._set.items():
            if self._clock() - self._chosen_at.get(name, -QUIET) >= QUIET:
                put(state[name])

    def _add_wind(self, gui: Any, blows: Sequence[float]) -> None:
        most = max(FASTEST_WIND, *map(abs, blows))
        wind = [gui.add_slider(f"wind {axis} [m/s]", -most, most, 0.5, v) for axis, v in zip("xyz", blows, strict=True)]

        def put(velocity: Sequence[float] | None) -> None:
            for slider, part in zip(wind, velocity or (), strict=False):
                slider.value = min(max(part, -most), most)

        for slider in wind:
            self._link("wind", slider, lambda: self._say("wind", *(float(each.value) for each in wind)), put)

    def _add_choice(self, gui: Any, name: str, known: list[str], now: str) -> None:
        """Have one of what is known chosen."""
        now = now if now in known else OWN
        choice = gui.add_dropdown(name, known if now in known else [OWN, *known], initial_value=now)

        def put(value: str) -> None:
            if value not in known and OWN not in choice.options:
                choice.options = [OWN, *known]
            choice.value = value if value in known else OWN

        self._link(name, choice, lambda: choice.value == OWN or self._say(name, choice.value), put)

    def _link(
        self, name: str, handle: Any, ask: Callable[[], object], put: Callable[[Any], None] | None = None
    ) -> None:
        """Ask for what somebody chooses at a control, and put it to what the run is at."""

        def chosen(event: Any) -> None:
            if event.client_id is None:
                return  # what is put there is chosen by nobody
            self._chosen_at[name] = self._clock()
            ask()

        def put_value(value: Any) -> None:
            handle.value = value

        handle.on_update(in_turn(chosen))
        self._set[name] = put or put_value
