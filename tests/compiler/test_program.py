"""Programs: units called in their order, with their groups, alone or within others.

They also run with the compiler off: NUMBA_DISABLE_JIT=1.
"""

from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from cape.kernels import store
from cape.kernels.jit import inlined, unit
from cape.kernels.linking import Linker
from cape.kernels.program import Nothing, Program, Use, run
from cape.kernels.team import Team
from tests.support.code import compiled_only

ROOM = 200


class Log(NamedTuple):
    """What units have noted: how `full` it is (1,), and who, the substep, how many, the step, and where (n, 6)."""

    full: NDArray[np.int64]
    lines: NDArray[np.float64]

    @property
    def noted(self) -> list[list[float]]:
        return self.lines[: self.full[0]].tolist()


class Named(NamedTuple):
    """A log, and a number to sign with."""

    log: Log
    number: float


class Within(NamedTuple):
    """A program that a unit runs, with half the step."""

    inner: Program
    log: Log


@inlined
def note(log, who, team, substep, substeps, step):
    line = log.lines[log.full[0]]
    line[0], line[1], line[2], line[3], line[4], line[5] = who, substep, substeps, step, team.lo, team.hi
    log.full[0] += 1


@unit
def sign(g, team, substep, substeps, step):
    note(g.log, g.number, team, substep, substeps, step)


@unit
def sign_backwards(g, team, substep, substeps, step):
    note(g.log, -g.number, team, substep, substeps, step)


@unit
def run_twice(g, team, substep, substeps, step):
    note(g.log, 100.0, team, substep, substeps, step)
    run(g.inner, team, 10 * substep, 2, 0.5 * step)
    run(g.inner, team, 10 * substep + 1, 2, 0.5 * step)


@unit
def nothing(g, team, substep, substeps, step):
    pass


@pytest.fixture
def log() -> Log:
    return Log(np.zeros(1, np.int64), np.zeros((ROOM, 6)))


def named(log: Log, *numbers: float) -> list[Named]:
    return [Named(log, number) for number in numbers]


def test_a_frame_calls_what_begins_it_once_and_the_rest_in_every_substep(log: Log):
    one, two, three, four = named(log, 1.0, 2.0, 3.0, 4.0)
    linker = Linker()
    begin = [Use(sign, one), Use(sign_backwards, two)]
    substep = [Use(sign, three), Use(nothing, Nothing()), Use(sign_backwards, one), Use(sign, four)]
    frame = linker.frame(begin, substep, Team(0, 1, 5, 9, np.zeros(16, np.int64)))
    linker.link()
    frame.run(3, 0.6)
    step = 0.6 / 3
    expected = [[1.0, 0, 3, step], [-2.0, 0, 3, step]]
    for k in range(3):
        expected += [[3.0, k, 3, step], [-1.0, k, 3, step], [4.0, k, 3, step]]
    assert [line[:4] for line in log.noted] == expected
    assert {tuple(line[4:]) for line in log.noted} == {(5.0, 9.0)}
    # Again, with steps of another number and length.
    log.full[0] = 0
    frame.run(1, 2.0)
    assert [line[:4] for line in log.noted] == [[who, 0, 1, 2.0] for who in (1.0, -2.0, 3.0, -1.0, 4.0)]


def test_a_frame_may_be_broken_off_between_its_steps(log: Log, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("cape.kernels.linking.BREATH", 0.0)  # back to Python after every step
    linker, looks = Linker(), []
    frame = linker.frame(
        [Use(sign, Named(log, 1.0))], [Use(sign_backwards, Named(log, 2.0))], Team(0, 1, 0, 1, np.zeros(16, np.int64))
    )
    linker.link()

    def look() -> None:
        looks.append(len(log.noted))
        if len(looks) == 4:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        frame.run(1000, 1.0, look)
    assert looks == [0, 2, 3, 4]
    assert [line[:3] for line in log.noted] == [[1.0, 0, 1000], *([-2.0, k, 1000] for k in range(3))]


def test_a_program_within_a_program(log: Log):
    linker = Linker()
    inner = linker.program([Use(sign, Named(log, 1.0)), Use(sign_backwards, Named(log, 2.0))])
    frame = linker.frame([], [Use(run_twice, Within(inner, log)), Use(sign, Named(log, 3.0))], Team.alone(7))
    linker.link()
    frame.run(2, 1.0)
    expected = []
    for k in range(2):
        expected.append([100.0, k, 2, 0.5])
        for at in (10 * k, 10 * k + 1):
            expected += [[1.0, at, 2, 0.25], [-2.0, at, 2, 0.25]]
        expected.append([3.0, k, 2, 0.5])
    assert [line[:4] for line in log.noted] == expected


def test_a_frame_of_nothing_and_one_without_a_beginning(log: Log):
    linker = Linker()
    frames = linker.frame([], [], Team.alone(1)), linker.frame([], [Use(sign, Named(log, 1.0))], Team.alone(1))
    linker.link()
    for frame in frames:
        frame.run(4, 1.0)
    assert [line[1] for line in log.noted] == [0.0, 1.0, 2.0, 3.0]


def test_programs_share_the_groups_that_they_have_in_common(log: Log):
    shared, own = Named(log, 1.0), Named(log, 2.0)
    linker = Linker()
    first, second = linker.program([Use(sign, shared), Use(sign, own)]), linker.program([Use(sign_backwards, shared)])
    linker.link()
    assert first.groups[0] == second.groups[0]
    assert first.groups[0] != first.groups[1]
    assert first.units[0] == first.units[1] != second.units[0]
    # What one of them does is seen by the other, and in Python.
    run(first, Team.alone(1), 0, 1, 1.0)
    log.lines[0, 0] = 7.0
    run(second, Team.alone(1), 0, 1, 1.0)
    assert [line[0] for line in log.noted] == [7.0, 2.0, -1.0]


def test_threads_each_have_their_own_frame_of_the_same_groups(log: Log):
    linker, group = Linker(), Named(log, 1.0)
    arrivals = np.zeros(32, np.int64)
    frames = [linker.frame([], [Use(sign, group)], Team(r, 2, 10 * r, 10 * r + 10, arrivals)) for r in range(2)]
    linker.link()
    for frame in (frames[1], frames[0]):
        frame.run(1, 1.0)
    assert [line[4:] for line in log.noted] == [[10.0, 20.0], [0.0, 10.0]]


@compiled_only
def test_code_is_asked_for_once_and_handed_to_all_who_want_it(log: Log, monkeypatch: pytest.MonkeyPatch):
    asked: list[list[store.Request]] = []
    prepare = store.prepare
    monkeypatch.setattr(store, "prepare", lambda requests: (asked.append(list(requests)), prepare(requests)))
    linker, found = Linker(), []
    program = linker.program([Use(sign, group) for group in named(log, 1.0, 2.0, 3.0)])
    linker.want(store.Request(sign, asked_kinds(linker, log)), found.append)
    assert (program.units == 0).all()
    assert found == []
    linker.link()
    assert (program.units == found[0]).all()
    assert found[0] != 0
    assert len(set(asked[0])) == 1
    linker.link()
    assert asked[1:] == [[]]
    assert len(found) == 1


def asked_kinds(linker: Linker, log: Log) -> tuple:
    ((request, _), *_) = linker._wanted
    return request.kinds
