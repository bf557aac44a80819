"""Which key does what."""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import NamedTuple

from cape.cli.live.cast import GAITS, Cast
from cape.cloth.fabrics import FABRICS
from cape.live.live import Live
from cape.solvers import SOLVERS

STRIDE = 0.03  # [m] by which a key moves an object: held down, about a metre a second
TURN = 15.0  # degrees by which a key turns a character, or the wind


class Binding(NamedTuple):
    """Keys, by the names that a terminal's have in prompt_toolkit, what they are called, and what they do."""

    keys: tuple[str, ...]
    shown: str
    help: str
    act: Callable[[], object]


class Bindings:
    """The keys of a live run.

    Attributes:
        all: in the order in which they are explained.
    """

    def __init__(self, live: Live, cast: Cast) -> None:
        """Those that make sense for what is simulated."""
        self._live, self._cast = live, cast
        self._gait = 0
        self._fabric, self._solver = _place(FABRICS, live.changes.fabric or "cape"), _place(SOLVERS, live.status.solver)
        self._bone = ""
        self.all = [*(self._steering() if cast.character is not None else self._objects()), *self._always()]
        self._by_key = {key: binding for binding in self.all for key in binding.keys}

    def press(self, key: str) -> bool:
        """Do what a key is for; False if it is for nothing."""
        binding = self._by_key.get(key)
        if binding is None:
            return False
        binding.act()
        return True

    def help(self) -> list[str]:
        """A line for each."""
        width = max(len(binding.shown) for binding in self.all)
        return [f"{binding.shown:>{width}}  {binding.help}" for binding in self.all]

    def _steering(self) -> list[Binding]:
        character = self._cast.character
        if character is None:
            return []
        own = [
            Binding((key,), key, f"{clip}, once", partial(character.go, clip))
            for key, clip in (("k", "kick"), ("j", "jump"), ("o", "spin"))
            if clip in character.clips
        ]
        turning = [
            Binding(("left",), "left", f"turn left by {TURN:g} degrees", lambda: character.turn(TURN)),
            Binding(("right",), "right", "turn right", lambda: character.turn(-TURN)),
        ]
        gaits = [gait for gait in GAITS if gait in character.clips]
        if len(gaits) > 1:
            turning = [
                Binding(("up",), "up", f"faster: {', '.join(gaits)}", lambda: self._change_gait(gaits, 1)),
                Binding(("down",), "down", "slower", lambda: self._change_gait(gaits, -1)),
                *turning,
            ]
        return [*turning, *own]

    def _change_gait(self, gaits: Sequence[str], by: int) -> None:
        character = self._cast.character
        if character is None:
            return
        now = character.walker.clip
        place = gaits.index(now) if now in gaits else self._gait
        self._gait = min(max(place + by, 0), len(gaits) - 1)
        character.go(gaits[self._gait])

    def _objects(self) -> list[Binding]:
        if not self._live.changes.bones:
            return []
        ways = {
            "left": (0.0, STRIDE, 0.0),
            "right": (0.0, -STRIDE, 0.0),
            "up": (0.0, 0.0, STRIDE),
            "down": (0.0, 0.0, -STRIDE),
            "pageup": (STRIDE, 0.0, 0.0),
            "pagedown": (-STRIDE, 0.0, 0.0),
        }
        shown = {"pageup": "page up", "pagedown": "page down"}
        told = {"left": "move it to the left", "pageup": "away from the eye", "pagedown": "nearer"}
        return [
            Binding(("c-i", "tab"), "tab", "choose the next object that moves", self._next_bone),
            *(
                Binding((key,), shown.get(key, key), told.get(key, f"move it {key}"), lambda by=by: self._move(by))
                for key, by in ways.items()
            ),
        ]

    def _next_bone(self) -> None:
        movable = self._movable()
        if movable:
            place = movable.index(self._bone) if self._bone in movable else -1
            self._bone = movable[(place + 1) % len(movable)]
            self._live.say(f"{self._bone} moves")

    def _movable(self) -> list[str]:
        """What holds the cloth or meets it, and what is pinned."""
        used = self._live.used_bones
        return [bone for bone in self._live.changes.bones if bone in used]

    def _move(self, by: tuple[float, float, float]) -> None:
        if self._bone not in self._movable():
            self._next_bone()
        if self._bone:
            self._live.changes.move(self._bone, by)

    def _always(self) -> list[Binding]:
        live, changes = self._live, self._live.changes
        corners = changes.corners[:9]
        pins = [
            Binding((str(n),), str(n), f"pin {corner}, or let it go", lambda n=n: changes.pin(n - 1))
            for n, corner in enumerate(corners, 1)
        ]
        return [
            Binding(("w",), "w", "wind on and off", changes.switch_wind),
            Binding(("[",), "[", "turn the wind to the left", lambda: changes.turn_wind(TURN)),
            Binding(("]",), "]", "turn it to the right", lambda: changes.turn_wind(-TURN)),
            *pins,
            Binding(("t",), "t", "tear the cloth", changes.tear),
            Binding(("f",), "f", "the next fabric", lambda: self._next_fabric(1)),
            Binding(("F",), "F", "the one before", lambda: self._next_fabric(-1)),
            Binding(("s",), "s", "the next solver", self._next_solver),
            Binding(("<",), "<", "fewer substeps", lambda: changes.set_substeps(0.8)),
            Binding((">",), ">", "more", lambda: changes.set_substeps(1.25)),
            Binding(("c",), "c", "self-contact on and off", changes.set_self_contact),
            Binding((" ",), "space", "pause", live.pause),
            Binding((".",), ".", "one frame", live.step),
            Binding(("-",), "-", "slower", lambda: live.set_speed(live.speed / 2.0)),
            Binding(("+", "="), "+", "faster, up to real time", lambda: live.set_speed(live.speed * 2.0)),
            Binding(("0",), "0", "put the cloth on anew", changes.reset),
            Binding(("q", "c-c", "c-d"), "q", "end", lambda: live.end("q was pressed")),
        ]

    def _next_fabric(self, by: int) -> None:
        names = list(FABRICS)
        self._fabric = (self._fabric + by) % len(names)
        self._live.changes.set_fabric(names[self._fabric])

    def _next_solver(self) -> None:
        names = list(SOLVERS)
        self._solver = (self._solver + 1) % len(names)
        self._live.changes.set_solver(names[self._solver])


def _place(names: Iterable[str], name: str) -> int:
    known = list(names)
    return known.index(name) if name in known else 0
