"""Threads that share a cloth: their vertices, their meetings, and how a team begins, fails and ends."""

import os
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from cape.kernels.records import Team
from hypothesis import given, settings
from hypothesis import strategies as st

from cape.kernels.jit import driver
from cape.kernels.team import BLOCK, GONE, LINE, meet, span
from cape.solvers import threads as module
from cape.solvers.threads import available_cores, cpu_quota, run


@driver
def miscounted(rows, rounds, team):
    """Each rank writes its row, meets the others and looks at theirs: how often they weren't as far, or too far."""
    wrong = 0
    for i in range(rounds):
        if team is not None:
            rows[team.rank, 0] = i
        meet(team)
        if team is not None:
            for rank in range(team.size):
                wrong += rows[rank, 0] != i
        meet(team)
    return wrong


@driver
def diffuse(values, other, rounds, team):
    """Replace each value by a mean with its neighbours, in as many rounds: every round reads what others wrote."""
    lo, hi = span(values.size, team)
    for _ in range(rounds):
        for i in range(lo, hi):
            left, right = values[max(i - 1, 0)], values[min(i + 1, values.size - 1)]
            other[i] = 0.3 * left + 0.5 * values[i] + 0.2 * right
        meet(team)
        for i in range(lo, hi):
            values[i] = other[i]
        meet(team)


@driver
def meet_often(times, team):
    for _ in range(times):
        meet(team)


def diffused(size: int, *, vertices: int = 1000, rounds: int = 200) -> tuple[np.ndarray, int]:
    values = np.random.default_rng(0).normal(size=vertices)
    other = np.zeros_like(values)
    used = run(diffuse, lambda team: (values, other, rounds, team), size)
    return values, used


# -- vertices --


@settings(deadline=None)  # the first one compiles
@given(vertices=st.integers(0, 10_000), size=st.integers(1, 9))
def test_spans_are_whole_blocks_that_follow_each_other(vertices: int, size: int):
    spans = [span(vertices, Team(rank, size, np.zeros(0, np.int64))) for rank in range(size)]
    ends = [0, *(hi for _, hi in spans)]
    assert [lo for lo, _ in spans] == ends[:-1]
    assert ends[-1] == vertices
    assert all(hi % BLOCK == 0 for _, hi in spans if hi != vertices)
    sizes = [-(-(hi - lo) // BLOCK) for lo, hi in spans]
    assert max(sizes) - min(sizes) <= 1


def test_one_thread_has_all_vertices():
    assert span(1000, None) == (0, 1000)


# -- meetings --


@pytest.mark.parametrize("size", [1, 2, 3, 4])
def test_no_rank_leaves_a_meeting_before_all_have_come(size: int):
    rounds = 20_000 if size <= 2 else 300  # with more ranks than cores every meeting takes turns of the scheduler
    rows = np.zeros((size, LINE), dtype=np.int64)
    arrivals = np.zeros(size * LINE, dtype=np.int64)
    miscounted(rows, 0, Team(0, size, arrivals))
    wrong = [-1] * size

    def go(rank: int) -> None:
        wrong[rank] = miscounted(rows, rounds, Team(rank, size, arrivals))

    threads = [threading.Thread(target=go, args=(rank,)) for rank in range(size)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == [0] * size
    assert arrivals[::LINE].tolist() == [2 * rounds] * size


def test_one_thread_compiles_to_no_meeting_at_all():
    script = """
import numpy as np
from cape.kernels.records import Team
from tests.solvers.test_threads import diffuse
values = np.zeros(100)
from numba import njit
fresh = njit(nogil=True, _nrt=False, error_model="numpy")(diffuse.py_func)
fresh(values, values.copy(), 1, None)
fresh(values, values.copy(), 1, Team(0, 1, np.zeros(16, np.int64)))
for signature in fresh.signatures:
    code = fresh.inspect_llvm(signature)
    print([word in code for word in ("atomic", "sched_yield", "pause")])
"""
    seen = _python(script).split("\n")
    assert seen[:2] == ["[False, False, False]", "[True, True, True]"]


def test_nobody_waits_for_a_rank_that_is_gone():
    arrivals = np.zeros(3 * LINE, dtype=np.int64)
    arrivals[LINE] = arrivals[2 * LINE] = GONE
    meet_often(1000, Team(0, 3, arrivals))
    assert arrivals[0] == 1000


def _python(script: str, **environment: str) -> str:
    """What a fresh process prints that can import this file."""
    place = {"PYTHONPATH": str(Path(__file__).parents[2])}
    done = subprocess.run(
        [sys.executable, "-c", script],
        env={**os.environ, **place, **environment},
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


# -- teams --


def test_any_number_of_ranks_gives_the_same_bits():
    alone, used = diffused(1)
    assert used == 1
    for size in (2, 3, 4):
        shared, used = diffused(size)
        assert used == size
        np.testing.assert_array_equal(shared, alone)
    assert np.abs(np.diff(alone)).max() < 0.1  # it did diffuse


def test_every_rank_gets_its_own_arguments():
    seen = []

    def note(rank, thread) -> None:
        seen.append((rank, threading.current_thread() is thread))

    used = run(note, lambda team: (None if team is None else team.rank, threading.current_thread()), 3)
    assert used == 3
    assert sorted(seen) == [(0, True), (1, False), (2, False)]


def test_a_team_within_a_team_is_one_thread():
    inner = []

    def outer() -> None:
        inner.append(diffused(2))

    assert run(outer, lambda team: (), 2) == 2
    alone, _ = diffused(1)
    assert [used for _, used in inner] == [1, 1]
    for values, _ in inner:
        np.testing.assert_array_equal(values, alone)


def test_teams_of_several_python_threads_go_side_by_side():
    alone, _ = diffused(1)
    wrong, used = [], []

    def work() -> None:
        for _ in range(100):
            values, size = diffused(2)
            wrong.append(not np.array_equal(values, alone))
            used.append(size)

    threads = [threading.Thread(target=work) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(wrong) == 300
    assert not any(wrong)
    assert 2 in used


@pytest.mark.parametrize("failing", [0, 1, 2])
def test_a_rank_that_fails_does_not_leave_the_others_waiting(failing: int):
    def frame(team) -> None:
        if team.rank == failing:
            raise ValueError(f"rank {team.rank}")
        meet_often(10, team)

    with pytest.raises(ValueError, match=f"rank {failing}"):
        run(frame, lambda team: (team,), 3)
    assert diffused(2)[1] == 2


@pytest.mark.parametrize("times", [(3, 5), (5, 3)])
def test_ranks_that_meet_unequally_often_are_found_out(times: tuple[int, int]):
    with pytest.raises(RuntimeError, match=f"unequally often: {times[0]}, {times[1]} times"):
        run(meet_often, lambda team: (times[team.rank] if team else 0, team), 2)


def test_arguments_that_cannot_be_made_stop_nobody():
    def arguments(team):
        if team.rank == 1:
            raise MemoryError
        return (1, team)

    with pytest.raises(MemoryError):
        run(meet_often, arguments, 2)
    assert diffused(2)[1] == 2


@pytest.mark.parametrize("when", [0.0, 0.01, 0.05])
def test_an_interrupt_ends_all_ranks_before_it_is_raised(when: float):
    at_work = []

    def frame(team) -> None:
        at_work.append(team.rank)
        meet_often(50_000, team)
        time.sleep(0.02 * team.rank)
        at_work.remove(team.rank)

    def interrupt() -> None:
        time.sleep(when)
        signal.raise_signal(signal.SIGINT)

    def go_on() -> None:
        thread.start()
        while True:
            run(frame, lambda team: (team,), 2)

    thread = threading.Thread(target=interrupt)
    with pytest.raises(KeyboardInterrupt):
        go_on()
    thread.join()
    assert 1 not in at_work
    assert diffused(2)[1] == 2


def test_a_child_process_has_a_team_of_its_own():
    script = """
import os, numpy as np
from tests.solvers.test_threads import diffused
here, used = diffused(2)
child = os.fork()
there, used_there = diffused(2)
np.testing.assert_array_equal(there, here)
assert used == used_there == 2
if child:
    assert os.waitpid(child, 0)[1] == 0
    print("both")
"""
    assert _python(script) == "both\n"


def test_another_process_takes_teams_from_the_cache(tmp_path: Path):
    script = """
from tests.solvers.test_threads import diffuse, diffused
import hashlib
values, used = diffused(2)
stats = diffuse.stats
print(used, sum(stats.cache_hits.values()), sum(stats.cache_misses.values()), hashlib.sha256(values).hexdigest())
"""
    first, second = (_python(script, NUMBA_CACHE_DIR=str(tmp_path)).split() for _ in range(2))
    assert first[:3] == ["2", "0", "1"]
    assert second[:3] == ["2", "1", "0"]
    assert first[3] == second[3]


def test_without_the_compiler_there_is_one_thread():
    script = (
        "from tests.solvers.test_threads import diffused; print(diffused(2)[1], diffused(1, rounds=2)[0].sum() != 0)"
    )
    assert _python(script, NUMBA_DISABLE_JIT="1") == "1 True\n"


def test_idle_helpers_let_the_process_end():
    assert _python("from tests.solvers.test_threads import diffused; print(diffused(4)[1])") == "4\n"


# -- cores --


def test_cores_are_those_that_the_process_may_use():
    script = """
import os
os.sched_setaffinity(0, [min(os.sched_getaffinity(0))])
from cape.team import available_cores
print(available_cores())
"""
    assert _python(script) == "1\n"
    assert 1 <= available_cores() <= (os.cpu_count() or 1)


def test_the_tightest_control_group_counts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    mount, own = tmp_path / "mount", tmp_path / "own"
    assert cpu_quota(mount, own) == np.inf
    (mount / "a/b").mkdir(parents=True)
    own.write_text("3:cpu:/elsewhere\n0::/a/b\n")
    assert cpu_quota(mount, own) == np.inf
    (mount / "a/b/cpu.max").write_text("max 100000\n")
    assert cpu_quota(mount, own) == np.inf
    (mount / "a/cpu.max").write_text("150000 100000\n")
    assert cpu_quota(mount, own) == 1.5
    (mount / "cpu.max").write_text("50000 100000\n")
    assert cpu_quota(mount, own) == 0.5
    monkeypatch.setattr(module, "CONTROL_GROUPS", mount)
    monkeypatch.setattr(module, "OWN_GROUPS", own)
    assert available_cores() == 1
    (mount / "cpu").mkdir()
    (mount / "cpu/cpu.cfs_quota_us").write_text("-1\n")
    (mount / "cpu/cpu.cfs_period_us").write_text("100000\n")
    assert cpu_quota(mount, own) == 0.5
    (mount / "cpu/cpu.cfs_quota_us").write_text("25000\n")
    assert cpu_quota(mount, own) == 0.25
