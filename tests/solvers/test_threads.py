"""Threads that share a cloth: their vertices, their meetings, and how a team begins, fails and ends."""

import os
import signal
import threading
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cape
from cape.cloth.fabric import Fabric
from cape.kernels.jit import routine
from cape.kernels.linking import Linker, arrivals_for
from cape.kernels.team import BLOCK, GONE, LINE, Team, meet, span
from cape.scene.scene import Scene
from cape.solvers import Solver
from cape.solvers import threads as module
from cape.solvers.running import Thread
from cape.solvers.threads import VERTICES_OF_A_THREAD, available_cores, cpu_quota, require_wanted, run, threads_for
from tests.support.processes import python
from tests.support.scenes import DOUBLE, Run, every_solver, grid_cloth


@routine
def miscounted(rows, rounds, team):
    """Each rank writes its row, meets the others and looks at theirs: how often they weren't as far, or too far."""
    wrong = 0
    for i in range(rounds):
        rows[team.rank, 0] = i
        meet(team)
        for rank in range(team.size):
            wrong += rows[rank, 0] != i
        meet(team)
    return wrong


@routine
def diffuse(values, other, rounds, team):
    """Replace each value by a mean with its neighbours, in as many rounds: every round reads what others wrote."""
    lo, hi = team.lo, team.hi
    for _ in range(rounds):
        for i in range(lo, hi):
            left, right = values[max(i - 1, 0)], values[min(i + 1, values.size - 1)]
            other[i] = 0.3 * left + 0.5 * values[i] + 0.2 * right
        meet(team)
        for i in range(lo, hi):
            values[i] = other[i]
        meet(team)


@routine
def meet_often(times, team):
    for _ in range(times):
        meet(team)


def member(rank: int, arrivals: np.ndarray, vertices: int = 0) -> Team:
    """A rank of the team that meets at `arrivals`."""
    size = len(arrivals) // LINE
    return Team(rank, size, *span(vertices, rank, size), arrivals)


def diffused(size: int, *, vertices: int = 1000, rounds: int = 200) -> tuple[np.ndarray, int]:
    values = np.random.default_rng(0).normal(size=vertices)
    other, arrivals = np.zeros_like(values), arrivals_for(size)
    used = run(
        lambda rank: diffuse(values, other, rounds, member(rank, arrivals, vertices)),
        lambda: diffuse(values, other, rounds, Team.alone(vertices)),
        arrivals,
    )
    return values, used


def never() -> None:
    """What a thread alone would do, where there must be several."""
    raise AssertionError("nobody else is at work")


# -- vertices --


@given(vertices=st.integers(0, 10_000), size=st.integers(1, 9))
def test_spans_are_whole_blocks_that_follow_each_other(vertices: int, size: int):
    spans = [span(vertices, rank, size) for rank in range(size)]
    ends = [0, *(hi for _, hi in spans)]
    assert [lo for lo, _ in spans] == ends[:-1]
    assert ends[-1] == vertices
    assert all(hi % BLOCK == 0 for _, hi in spans if hi != vertices)
    sizes = [-(-(hi - lo) // BLOCK) for lo, hi in spans]
    assert max(sizes) - min(sizes) <= 1


def test_one_thread_has_all_vertices():
    assert span(1000, 0, 1) == (0, 1000)
    alone = Team.alone(1000)
    assert (alone.rank, alone.size, alone.lo, alone.hi) == (0, 1, 0, 1000)


# -- meetings --


@pytest.mark.parametrize("size", [1, 2, 3, 4])
def test_no_rank_leaves_a_meeting_before_all_have_come(size: int):
    rounds = 20_000 if size <= 2 else 300  # with more ranks than cores every meeting takes turns of the scheduler
    rows = np.zeros((size, LINE), dtype=np.int64)
    arrivals = np.zeros(size * LINE, dtype=np.int64)
    miscounted(rows, 0, member(0, arrivals))
    wrong = [-1] * size

    def go(rank: int) -> None:
        wrong[rank] = miscounted(rows, rounds, member(rank, arrivals))

    threads = [threading.Thread(target=go, args=(rank,)) for rank in range(size)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert wrong == [0] * size
    # A thread alone has nobody to wait for, and does not even count.
    assert arrivals[::LINE].tolist() == [2 * rounds if size > 1 else 0] * size


@every_solver
def test_the_frame_of_a_thread_alone_has_no_meeting_at_all(solver: Solver):
    cloth = grid_cloth(np.linspace(0, 0.1, 5), np.linspace(0, 0.1, 5), Fabric())
    colliders = [cape.Sphere(radius=0.001), cape.Plane()]
    scene = Scene(cloth, colliders=colliders, wind=cape.Wind(), self_contact=cape.SelfContact())
    running = Run(scene, solver, threads=2).running
    counts = []
    for rank, size in ((0, 1), (0, 2), (1, 2)):
        order = solver.units(Thread(running, rank, size, None), Linker())
        counts.append(sum(use.unit.__name__ == "wait_for_all" for use in (*order.begin, *order.substep)))
    assert counts[0] == 0
    assert counts[1] == counts[2] > 4


def test_nobody_waits_for_a_rank_that_is_gone():
    arrivals = np.zeros(3 * LINE, dtype=np.int64)
    arrivals[LINE] = arrivals[2 * LINE] = GONE
    meet_often(1000, member(0, arrivals))
    assert arrivals[0] == 1000


# -- teams --


def test_any_number_of_ranks_gives_the_same_bits():
    alone, used = diffused(1)
    assert used == 1
    for size in (2, 3, 4):
        shared, used = diffused(size)
        assert used == size
        np.testing.assert_array_equal(shared, alone)
    assert np.abs(np.diff(alone)).max() < 0.1  # it did diffuse


def test_every_rank_is_called_once_the_first_on_the_calling_thread():
    seen, caller = [], threading.current_thread()
    used = run(lambda rank: seen.append((rank, threading.current_thread() is caller)), never, arrivals_for(3))
    assert used == 3
    assert sorted(seen) == [(0, True), (1, False), (2, False)]


def test_a_team_within_a_team_is_one_thread():
    inner = []

    def outer() -> None:
        inner.append(diffused(2))

    assert run(lambda rank: outer(), never, arrivals_for(2)) == 2
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
    arrivals = arrivals_for(3)

    def frame(rank: int) -> None:
        if rank == failing:
            raise ValueError(f"rank {rank}")
        meet_often(10, member(rank, arrivals))

    with pytest.raises(ValueError, match=f"rank {failing}"):
        run(frame, never, arrivals)
    assert diffused(2)[1] == 2


@pytest.mark.parametrize("times", [(3, 5), (5, 3)])
def test_ranks_that_meet_unequally_often_are_found_out(times: tuple[int, int]):
    arrivals = arrivals_for(2)
    with pytest.raises(RuntimeError, match=f"unequally often: {times[0]}, {times[1]} times"):
        run(lambda rank: meet_often(times[rank], member(rank, arrivals)), never, arrivals)


@pytest.mark.parametrize("when", [0.0, 0.01, 0.05])
def test_an_interrupt_ends_all_ranks_before_it_is_raised(when: float):
    at_work, arrivals = [], arrivals_for(2)

    def frame(rank: int) -> None:
        at_work.append(rank)
        meet_often(50_000, member(rank, arrivals))
        time.sleep(0.02 * rank)
        at_work.remove(rank)

    def interrupt() -> None:
        time.sleep(when)
        signal.raise_signal(signal.SIGINT)

    def go_on() -> None:
        thread.start()
        while True:
            run(frame, never, arrivals)

    thread = threading.Thread(target=interrupt)
    with pytest.raises(KeyboardInterrupt):
        go_on()
    thread.join()
    assert 1 not in at_work
    assert diffused(2)[1] == 2


def test_ranks_end_soon_when_one_is_interrupted():
    """The second rank would go on for ever, were it not told that nobody wants what it does."""

    def frame(rank: int) -> None:
        while True:
            if rank == 0:
                raise KeyboardInterrupt
            require_wanted()

    arrivals = arrivals_for(2)
    for _ in range(20):
        with pytest.raises(KeyboardInterrupt):
            run(frame, never, arrivals)
    require_wanted()  # who called them is wanted still
    assert diffused(2)[1] == 2


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("solver", DOUBLE, ids=lambda s: s.name)
def test_how_often_a_frame_comes_back_never_shows(solver: Solver, threads: int, monkeypatch: pytest.MonkeyPatch):
    def positions(breath: float) -> np.ndarray:
        monkeypatch.setattr("cape.kernels.linking.BREATH", breath)
        cloth = cape.Cloth.rectangle(width=1.0, height=1.0, spacing=0.1)
        scene = cape.Scene(cloth, [cape.attach(cloth, "rod", "top")])
        simulation = cape.Simulation(scene, solver=replace(solver, substeps=100), threads=threads)
        for x in (0.0, 0.1, 0.3):
            simulation.step({"rod": ([x, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0])}, 1 / 60)
        return simulation.positions

    whole = positions(1e6)
    assert np.ptp(whole[:, 1]) > 0.0 or np.ptp(whole[:, 0]) > 0.0
    np.testing.assert_array_equal(positions(0.0), whole)


def test_an_interrupt_is_heard_within_a_frame():
    """A frame of a million steps is broken off, its cloth is where it was, and goes on from there."""
    cloth = cape.Cloth.rectangle(width=1.0, height=1.0, spacing=0.05)
    simulation = cape.Simulation(cape.Scene(cloth, [cape.attach(cloth, "rod", "top")]))
    pose = {"rod": ([0.0, 0.0, 0.0], [1.0, 0.0, 0.0, 0.0])}
    simulation.start(pose)
    simulation.step(pose, 1 / 60)
    before = simulation.positions
    simulation.change_solver(cape.SymplecticEuler(substeps=1_000_000))
    timer = threading.Timer(0.3, signal.raise_signal, [signal.SIGINT])
    timer.start()
    with pytest.raises(KeyboardInterrupt):
        simulation.step(pose, 1 / 60)
    timer.join()
    np.testing.assert_array_equal(simulation.positions, before)
    (programs,) = simulation._started.running.frames.values()
    assert 0 < programs._alone._call.part[1] < 1_000_000


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
    assert python(script) == "both\n"


def test_another_process_takes_teams_from_the_cache(tmp_path: Path):
    script = """
from cape.kernels import store
from tests.solvers.test_threads import diffused
import hashlib
values, used = diffused(2)
print(used, store.compiled.count("diffuse"), len(store.compiled), hashlib.sha256(values).hexdigest())
"""
    first, second = (python(script, NUMBA_CACHE_DIR=str(tmp_path)).split() for _ in range(2))
    assert first[:3] == ["2", "1", "1"]
    assert second[:3] == ["2", "0", "0"]
    assert first[3] == second[3]


def test_without_the_compiler_there_is_one_thread():
    script = (
        "from tests.solvers.test_threads import diffused; print(diffused(2)[1], diffused(1, rounds=2)[0].sum() != 0)"
    )
    assert python(script, NUMBA_DISABLE_JIT="1") == "1 True\n"


def test_idle_helpers_let_the_process_end():
    assert python("from tests.solvers.test_threads import diffused; print(diffused(4)[1])") == "4\n"


# -- cores --


def test_cores_are_those_that_the_process_may_use():
    script = """
import os
os.sched_setaffinity(0, [min(os.sched_getaffinity(0))])
from cape.solvers.threads import available_cores
print(available_cores())
"""
    assert python(script) == "1\n"
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


@pytest.mark.parametrize(
    ("granted", "threads"), [("1", 1), ("2", 2), ("2,4", 2), ("9", 3), ("", 3), ("0", 3), ("many", 3), ("-1", 3)]
)
def test_threads_are_as_many_as_are_granted(granted: str, threads: int, monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", granted)
    monkeypatch.setattr("cape.solvers.threads.available_cores", lambda: 4)
    assert threads_for(3 * VERTICES_OF_A_THREAD) == threads
    assert threads_for(VERTICES_OF_A_THREAD) == 1
