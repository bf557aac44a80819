"""A sheet that swings, and what changes it, for the tests of what a live run is built of."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import cape
from cape.live.builder import Builder
from cape.live.changes import Changes
from cape.live.rig import Rig
from cape.live.sources import TrackSource
from cape.scene.standard_scenes import swing


class AtOnce(Builder):
    """Makes what it is asked for at once."""

    def ask(self, name: str, make: Callable[[], Any], ready: Callable[[Any], Any]) -> None:
        ready(make())


class Later(Builder):
    """Makes what it is asked for when it is told to, and hands over what it has made once that is asked for."""

    def __init__(self) -> None:
        super().__init__()
        self.waiting: dict[str, tuple[Callable[[], Any], Callable[[Any], Any]]] = {}
        self.made: list[tuple[Callable[[Any], Any], Any]] = []

    def ask(self, name: str, make: Callable[[], Any], ready: Callable[[Any], Any]) -> None:
        self.waiting[name] = make, ready

    def work(self) -> None:
        self.made += [(ready, make()) for make, ready in self.waiting.values()]
        self.waiting = {}

    def hand_over(self) -> list[str]:
        made, self.made = self.made, []
        return [ready(each) for ready, each in made]


def at_once(change: Callable[[], str | None]) -> None:
    change()


def swinging(*, self_contact: bool = True, spacing: float = 0.1) -> tuple[Rig, Changes, Later]:
    """A sheet that has swung for a while, and what changes it; what is asked for is done at once.

    The `spacing` of its vertices [m] tells how many steps symplectic Euler needs.
    """
    standard, builder = swing(spacing=spacing), Later()
    scene = replace(standard.scene, self_contact=cape.SelfContact() if self_contact else None)
    rig = Rig(scene, TrackSource(standard.track), cape.SymplecticEuler(), threads=1)
    rig.start()
    advance(rig, 40)
    return rig, Changes(rig, builder, at_once), builder


def advance(rig: Rig, frames: int) -> None:
    for _ in range(frames):
        rig.step(1.0 / 60.0)
