"""Steps in time with a clock that the tests turn."""

import threading
from itertools import pairwise

import pytest

from cape.live.pace.falling_behind import LOOKED_AT, PATIENCE, TRIAL, VAIN, FallingBehind
from cape.live.pace.pacing import Pacer

PERIOD = 1.0 / 64.0  # s, which adds up without rounding
NEVER = threading.Event()


class Clock:
    """A clock that only sleeping, and working, turns on."""

    def __init__(self) -> None:
        self.now = 100.0

    def __call__(self) -> float:
        return self.now

    def sleep(self, seconds: float) -> None:
        assert seconds > 0.0
        self.now += seconds


def paced(clock: Clock, takes: list[float]) -> tuple[Pacer, list[float]]:
    """A pacer that has taken steps of so long [s], and when each began after the first [s]."""
    pacer, begun = Pacer(PERIOD, clock=clock, sleep=clock.sleep), []
    pacer.begin()
    for seconds in takes:
        assert pacer.wait(NEVER)
        begun.append(clock.now - 100.0)
        clock.now += seconds
        pacer.done()
    return pacer, begun


def test_steps_begin_when_they_are_due_however_long_they_take():
    _, begun = paced(Clock(), [0.001, 0.009, 0.0, 0.015, 0.003])
    assert begun == pytest.approx([k * PERIOD for k in range(5)], abs=1e-12)


def test_a_step_that_takes_too_long_puts_off_the_next_and_no_other():
    pacer, begun = paced(Clock(), [0.001, 3.5 * PERIOD, 0.001, 0.001])
    assert begun == pytest.approx([0.0, PERIOD, 4.5 * PERIOD, 5.5 * PERIOD], abs=1e-12)
    assert pacer.lost == pytest.approx(2.5 * PERIOD, abs=1e-12)
    assert pacer.mean_late == pytest.approx(0.0, abs=1e-12)


def test_the_rate_is_that_of_steps_to_those_that_were_due():
    assert paced(Clock(), [0.5 * PERIOD] * 200)[0].rate == 1.0
    assert paced(Clock(), [2.0 * PERIOD] * 200)[0].rate == pytest.approx(0.5, abs=1e-9)


def test_waiting_ends_with_the_run():
    clock, over = Clock(), threading.Event()
    pacer = Pacer(PERIOD, clock=clock, sleep=lambda seconds: (clock.sleep(seconds), over.set()))  # pyright: ignore[reportArgumentType]
    pacer.begin()
    assert pacer.wait(over)
    pacer.done()
    assert not pacer.wait(over)
    assert clock.now < 100.0 + PERIOD


def levels(behind: FallingBehind, seconds: float, frames: int) -> list[int]:
    return [behind.note(seconds, PERIOD) for _ in range(frames)]


def test_nothing_is_given_up_while_steps_fit():
    assert set(levels(FallingBehind(3), 0.9 * PERIOD, 500)) == {0}


def test_one_thing_after_the_other_is_given_up_and_no_more_than_there_are():
    behind = FallingBehind(2)
    assert levels(behind, 1.5 * PERIOD, LOOKED_AT)[-2:] == [0, 1]
    assert levels(behind, 1.2 * PERIOD, LOOKED_AT)[-2:] == [1, 2]
    assert set(levels(behind, 1.0 * PERIOD, 1000)) == {2}
    assert behind.lowest


def test_a_single_slow_frame_gives_nothing_up():
    behind = FallingBehind(2)
    levels(behind, 0.5 * PERIOD, 100)
    behind.note(10.0 * PERIOD, PERIOD)
    assert set(levels(behind, 0.5 * PERIOD, 100)) == {0}


def test_what_was_given_up_comes_back_when_the_machine_is_free_again():
    """A frame of 20 ms took 10 ms in the cheaper way; at 4 ms in that one it will take 8 ms, which fits."""
    behind = FallingBehind(1)
    levels(behind, 20.0 / 15.6 * PERIOD, LOOKED_AT)
    levels(behind, 10.0 / 15.6 * PERIOD, 3 * PATIENCE)
    assert behind.level == 1  # at 20 ms there would be no room
    assert levels(behind, 4.0 / 15.6 * PERIOD, PATIENCE + 2 * LOOKED_AT)[-1] == 0


def test_what_comes_back_in_vain_is_left_alone_for_longer_each_time():
    behind, waits = FallingBehind(1), []
    levels(behind, 1.5 * PERIOD, LOOKED_AT)
    for _ in range(4):
        levels(behind, 1.0 * PERIOD, LOOKED_AT)  # in the cheaper way, under load
        waited = 0
        while behind.note(0.4 * PERIOD, PERIOD) == 1:
            waited += 1
            assert waited < 5000
        waits.append(waited)
        levels(behind, 1.5 * PERIOD, LOOKED_AT)
        assert behind.level == 1
    assert all(later > 1.5 * before for before, later in pairwise(waits))


def test_what_seemed_to_have_no_room_is_tried_again_ever_more_seldom():
    """The machine was busy when a level was left, and free in the next one: it is not more than twice as cheap."""
    behind, waits = FallingBehind(1), []
    levels(behind, 4.0 * PERIOD, LOOKED_AT)
    for _ in range(3):
        waited = 0
        while behind.note(0.3 * PERIOD, PERIOD) == 1:
            waited += 1
            assert waited < 20 * TRIAL
        waits.append(waited)
        levels(behind, 4.0 * PERIOD, LOOKED_AT)
        assert behind.level == 1
    assert waits[0] == pytest.approx(TRIAL, abs=2 * LOOKED_AT)
    assert all(later > 1.9 * before for before, later in pairwise(waits))
    while behind.note(0.3 * PERIOD, PERIOD) == 1:
        pass
    assert set(levels(behind, 0.6 * PERIOD, 2 * TRIAL)) == {0}


def waited_for(behind: FallingBehind, seconds: float, level: int) -> int:
    """How many frames of so long [s] it takes until a level is in force."""
    for count in range(1, 40 * TRIAL):
        if behind.note(seconds, PERIOD) == level:
            return count
    raise AssertionError(f"never at {level}")


def test_what_saves_nothing_is_given_back_and_tried_again_ever_more_seldom():
    behind, waits = FallingBehind(2), []
    assert waited_for(behind, 1.5 * PERIOD, 1) == LOOKED_AT
    assert not behind.lowest
    assert waited_for(behind, 1.2 * PERIOD, 2) == LOOKED_AT
    for _ in range(3):
        assert waited_for(behind, 1.15 * PERIOD, 1) == LOOKED_AT  # 4 % are nothing
        assert behind.saved_nothing
        assert behind.lowest
        waits.append(waited_for(behind, 1.2 * PERIOD, 2))
        assert not behind.saved_nothing
    assert waits == [VAIN, 2 * VAIN, 4 * VAIN]
    assert set(levels(behind, 1.0 * PERIOD, 1000)) == {2}  # by now it saves something


def test_what_saves_nothing_is_skipped_where_the_next_one_does():
    behind = FallingBehind(2)
    levels(behind, 1.5 * PERIOD, LOOKED_AT)
    assert waited_for(behind, 1.5 * PERIOD, 2) == LOOKED_AT
    assert set(levels(behind, 1.0 * PERIOD, 50)) == {2}
    # Not by way of what saves nothing.
    assert PATIENCE <= waited_for(behind, 0.3 * PERIOD, 0) <= PATIENCE + LOOKED_AT
    assert waited_for(behind, 1.5 * PERIOD, 2) == LOOKED_AT


def test_where_nothing_saves_anything_all_is_as_asked_for():
    behind = FallingBehind(3)
    seen = levels(behind, 1.5 * PERIOD, 5 * LOOKED_AT)
    assert [level for level, before in zip(seen, [None, *seen], strict=False) if level != before] == [0, 1, 2, 3, 0]
    assert behind.lowest


def test_what_fits_is_kept_however_little_it_has_saved():
    behind = FallingBehind(1)
    levels(behind, 1.0 * PERIOD, LOOKED_AT)
    assert set(levels(behind, 0.94 * PERIOD, 500)) == {1}


def test_a_level_is_measured_by_how_long_frames_took_last_before_it():
    """The machine becomes busy: the mean of frames before is far less than what they take by now."""
    behind = FallingBehind(1)
    levels(behind, 0.5 * PERIOD, 100)
    waited_for(behind, 1.6 * PERIOD, 1)
    assert set(levels(behind, 1.2 * PERIOD, 500)) == {1}


def test_what_is_saved_shows_also_while_others_compute_now_and_then():
    """Of a frame a third is saved, of the mean nothing: two of three take thrice as long, where it was one in five."""
    behind = FallingBehind(1)
    for k in range(LOOKED_AT):
        behind.note((3.6 if k % 5 == 0 else 1.2) * PERIOD, PERIOD)
    assert behind.level == 1
    assert {behind.note((2.4 if k % 3 else 0.8) * PERIOD, PERIOD) for k in range(1000)} == {1}


def test_what_has_saved_something_after_all_is_taken_again_at_once_but_only_once():
    """Others begin to compute just as a level is left: that is seen once it is in force again."""
    behind = FallingBehind(1)
    levels(behind, 1.0 * PERIOD, LOOKED_AT)
    for again in (LOOKED_AT, 2 * VAIN):
        assert waited_for(behind, 1.4 * PERIOD, 0) == LOOKED_AT
        assert waited_for(behind, 2.0 * PERIOD, 1) == again
        behind._left[-1].least = 1.0 * PERIOD  # as busy again as at first


def test_what_may_save_something_under_other_circumstances_is_tried():
    behind = FallingBehind(1)
    levels(behind, 1.2 * PERIOD, 2 * LOOKED_AT)
    assert behind.level == 0
    assert behind.lowest
    behind.forget()
    assert not behind.lowest
    assert levels(behind, 1.2 * PERIOD, LOOKED_AT)[-1] == 1
