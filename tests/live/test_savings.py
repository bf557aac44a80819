"""What a live run gives up where it is slower than the clock, on a machine that the tests make as slow as they like."""

from collections.abc import Callable

import cape
from cape.live.changes import Changes
from cape.live.pace.falling_behind import LOOKED_AT, VAIN
from cape.live.pace.savings import IN_TIME, Savings
from cape.live.rig import Rig
from tests.live.rigs import advance, swinging


def savings(rig: Rig, changes: Changes) -> tuple[Savings, Callable[[float, int], list[str]]]:
    """What gives up something of a run on a machine as fast as told, and what has that be so for some frames.

    A frame of symplectic Euler takes 0.6 of a period, one of XPBD in 20 steps 0.3, times how busy the machine is.
    """
    saved, own = Savings(rig, changes), rig.simulation.substeps

    def frames(busy: float, count: int) -> list[str]:
        seen = []
        for _ in range(count):
            of = {"euler": 0.6 / own, "xpbd": 0.3 / 20.0}[rig.solver.name]
            substeps = rig.simulation.own_substeps(1.0 / 60.0) if rig.solver.substeps is None else rig.solver.substeps
            saved.note(busy * of * substeps / 60.0, 1.0 / 60.0)
            seen.append(saved.told(1.0))
        return [told for told, before in zip(seen, [None, *seen], strict=False) if told != before]

    return saved, frames


def test_what_is_too_slow_is_given_up_and_taken_back_in_order_without_waiting():
    """First it goes on in XPBD, which stands ready, in 20 steps, then in 10; then slower; and all the way back."""
    rig, changes, builder = swinging()
    first, euler = rig.simulation, rig.solver
    saved, frames = savings(rig, changes)
    assert frames(1.0, 200) == [""]
    builder.work()  # since more than half of the time is used
    builder.hand_over()
    assert rig.simulation is first
    assert frames(2.0, LOOKED_AT + 1) == ["", "xpbd in 20"]
    assert rig.solver == cape.XPBD(substeps=20)
    assert not builder.waiting
    advance(rig, 3)
    assert frames(2.0, 1000) == ["xpbd in 20"]
    assert frames(4.0, LOOKED_AT + 1) == ["xpbd in 20", "xpbd in 10"]
    assert frames(8.0, 1000) == ["xpbd in 10"]
    assert saved.told(0.8) == "xpbd in 10, slower than real time"
    # Where the rate goes up and down about that, the line stays as it is.
    assert {saved.told(rate) for rate in (1.0, 0.96, 1.0, 1.0) * IN_TIME} == {"xpbd in 10, slower than real time"}
    assert [saved.told(1.0) for _ in range(IN_TIME)][-1] == "xpbd in 10"
    assert frames(1.0, 1000) == ["xpbd in 10", "xpbd in 20", ""]
    assert rig.simulation is first
    assert rig.solver == euler
    assert not builder.waiting
    advance(rig, 3)
    assert frames(1.0, 1000) == [""]


def test_a_level_that_saves_nothing_is_given_back_with_a_word():
    """As where most of a frame goes into the cloth's contact with itself, whatever the solver's steps."""
    rig, _, builder = swinging()
    said: list[str | None] = []
    changes = Changes(rig, builder, lambda change: said.append(change()))
    saved, told = Savings(rig, changes), []

    def frames(count: int) -> None:
        for _ in range(count):
            took = {"euler": 2.0, "xpbd": 1.2 + 0.002 * (rig.solver.substeps or 0)}[rig.solver.name]
            saved.note(took / 60.0, 1.0 / 60.0)
            told.append(saved.told(0.8))
            builder.work()
            said.extend(builder.hand_over())

    frames(3 * LOOKED_AT)
    assert [each for each in said if each] == [
        "too slow: xpbd in 20", "too slow: xpbd in 10", "xpbd in 10 saves nothing: xpbd in 20",
    ]  # fmt: skip
    assert rig.solver == cape.XPBD(substeps=20)
    assert told[-1] == "xpbd in 20, slower than real time"
    frames(VAIN - 1)
    assert set(told[3 * LOOKED_AT :]) == {"xpbd in 20, slower than real time"}
    changes.set_self_contact(False)
    frames(2 * LOOKED_AT)
    assert "too slow: xpbd in 10" in said[-2:]


def test_where_euler_needs_more_steps_xpbd_takes_as_many_as_it_needs_before_it_takes_few():
    """A frame in them is still taken again where threads get too long, which in few steps it is not."""
    rig, changes, builder = swinging(spacing=0.04)
    assert rig.simulation.substeps > 40
    _, frames = savings(rig, changes)
    frames(1.0, 200)
    builder.work()
    builder.hand_over()
    assert frames(2.0, LOOKED_AT + 1) == ["", "xpbd"]
    assert rig.solver == cape.XPBD()
    advance(rig, 3)
    assert rig.simulation.substeps == 40
    assert frames(4.0, 1000) == ["xpbd", "xpbd in 20", "xpbd in 10"]


def test_substeps_that_stability_can_do_without_are_given_up_first():
    rig, changes, builder = swinging()
    own = rig.simulation.substeps
    _, frames = savings(rig, changes)
    changes.set_substeps(3.0)
    advance(rig, 1)
    assert frames(1.0, 100) == ["", f"{own} substeps"]
    assert rig.solver == cape.SymplecticEuler(substeps=own)
    assert not builder.waiting
    advance(rig, 3)
    assert frames(0.3, 1000) == [f"{own} substeps", ""]
    assert rig.solver == cape.SymplecticEuler(substeps=3 * own)


def test_while_a_cloth_is_made_ready_nothing_more_is_given_up():
    rig, changes, builder = swinging()
    saved, frames = savings(rig, changes)
    assert frames(2.0, 1000) == ["", "xpbd in 20"]
    assert rig.solver.name == "euler"
    assert saved.told(0.8) == "xpbd in 20, slower than real time"
    builder.work()
    assert builder.hand_over() == ["too slow: xpbd in 20"]
    assert rig.solver == cape.XPBD(substeps=20)
    assert frames(2.0, 1000) == ["xpbd in 20"]


def test_what_stood_ready_for_another_scene_is_not_used():
    rig, changes, builder = swinging()
    _, frames = savings(rig, changes)
    frames(1.0, 200)
    builder.work()
    changes.set_self_contact(False)
    builder.work()
    builder.hand_over()
    assert rig.ready(cape.XPBD()) is None
    frames(1.0, 200)
    builder.work()
    builder.hand_over()
    ready = rig.ready(cape.XPBD())
    assert ready is not None
    assert ready.simulation.scene is rig.scene


def test_a_grid_that_may_tear_is_not_stepped_otherwise_however_slow():
    rig, changes, builder = swinging()
    changes.tear()
    builder.work()
    builder.hand_over()
    advance(rig, 1)
    _, frames = savings(rig, changes)
    assert frames(4.0, 1000) == [""]
    assert not builder.waiting
