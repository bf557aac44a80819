"""Many capes at once: the bits of each alone, whatever happens to the others."""

import signal
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from cape import Diverged, Simulation, SymplecticEuler
from cape.run.batch import Batch
from cape.solvers.threads import available_cores
from motions.errors import UnknownNameError, ValueRangeError
from tests.run.test_simulation import SOFT, ExplodesAfter, hanging, swing

# Uneven capes: 24 to 216 vertices, and substeps that follow from the spacing.
SPACINGS = (0.1, 0.025, 0.05, 0.04, 0.08, 0.03)


@dataclass(frozen=True, kw_only=True)
class Observed(SymplecticEuler):
    """Calls something at each frame."""

    act: Callable[[], None] = lambda: None

    def step(self, running, motion, **options):
        self.act()
        return super().step(running, motion, **options)


def capes(*, solver: SymplecticEuler | None = None) -> list[Simulation]:
    return [Simulation(hanging(SOFT, spacing=spacing), solver=solver) for spacing in SPACINGS]


def places(frame: int, count: int = len(SPACINGS)) -> list:
    """Each character is a little later in its swing."""
    return [swing(frame / 60 - index / 100) for index in range(count)]


def run_alone(index: int, frames: int) -> np.ndarray:
    simulation = capes()[index]
    simulation.start(places(0)[index], settle=0.1)
    for frame in range(1, frames + 1):
        simulation.step(places(frame)[index], 1 / 60)
    return simulation.positions


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_each_cape_has_the_bits_that_it_has_alone(threads: int):
    batch = Batch(capes(), threads=threads)
    assert len(batch) == len(SPACINGS)
    batch.start(places(0), settle=0.1)
    for frame in range(1, 11):
        batch.step(places(frame), 1 / 60)
    for index, positions in enumerate(batch.positions):
        np.testing.assert_array_equal(positions, run_alone(index, 10))
    assert batch.failures == {}


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_capes_are_stepped_on_as_many_threads_as_asked(threads: int):
    together = threading.Barrier(threads)
    at_work, most = [], []

    def act() -> None:
        at_work.append(1)
        most.append(len(at_work))
        together.wait(timeout=30.0)
        at_work.pop()

    batch = Batch(capes(solver=Observed(act=act)), threads=threads)
    batch.start(places(0), settle=0.0)
    batch.step(places(1), 1 / 60)
    assert max(most) == threads
    assert len(most) == len(batch)


def test_all_cores_are_used_unless_asked_otherwise():
    assert Batch([]).threads == available_cores()


def test_the_dearest_come_first(monkeypatch: pytest.MonkeyPatch):
    order, clock = [], [0.0]
    monkeypatch.setattr("cape.run.batch.time", SimpleNamespace(perf_counter=lambda: clock[0]))
    simulations = capes()

    def act(index: int) -> None:
        order.append(index)
        clock[0] += 1.0 - 0.1 * index

    for index, simulation in enumerate(simulations):
        simulation.solver = Observed(act=partial(act, index))
    batch = Batch(simulations, threads=1)
    batch.start(places(0), settle=0.0)
    assert order == []
    batch.step(places(1), 1 / 60)
    # Before anything is known, by the number of vertices.
    assert order == sorted(range(6), key=lambda index: SPACINGS[index])
    order.clear()
    batch.step(places(2), 1 / 60)
    assert order == [0, 1, 2, 3, 4, 5]


def test_a_velocity_and_a_spin_for_each_or_for_all():
    velocities = np.linspace(-1, 1, 18).reshape(6, 3)
    batch, same = Batch(capes()), Batch(capes())
    batch.start(places(0), settle=0.0, velocities=velocities, spins=(0, 0, 2.0))
    same.start(places(0), settle=0.0)
    for index, simulation in enumerate(batch.simulations):
        alone = capes()[index]
        alone.start(places(0)[index], settle=0.0, velocity=velocities[index], spin=(0, 0, 2.0))
        np.testing.assert_array_equal(simulation.velocities, alone.velocities)
        assert np.abs(simulation.velocities - same.simulations[index].velocities).max() > 0.1


# -- failure --


@pytest.mark.parametrize("threads", [1, 2])
def test_a_cape_that_diverges_stops_alone_at_its_last_good_state(threads: int):
    simulations = capes()
    simulations[2].solver = solver = ExplodesAfter(frame=4)
    batch = Batch(simulations, threads=threads)
    batch.start(places(0), settle=0.0)
    for frame in range(1, 4):
        batch.step(places(frame), 1 / 60)
    assert not batch.failures
    good = batch.positions[2]
    batch.step(places(4), 1 / 60)
    tried = len(solver.stepped)
    for frame in range(5, 9):
        batch.step(places(frame), 1 / 60)
    assert len(solver.stepped) == tried
    assert list(batch.failures) == [2]
    assert isinstance(batch.failures[2], Diverged)
    np.testing.assert_array_equal(batch.positions[2], good)
    healthy = Batch(capes())
    healthy.start(places(0), settle=0.0)
    for frame in range(1, 9):
        healthy.step(places(frame), 1 / 60)
    for index in (0, 1, 3, 4, 5):
        np.testing.assert_array_equal(batch.positions[index], healthy.positions[index])
    batch.start(places(0), settle=0.0)
    assert batch.failures == {}


@pytest.mark.parametrize("threads", [1, 2])
def test_a_bad_pose_is_named_and_the_other_capes_are_stepped(threads: int):
    batch, sound = Batch(capes(), threads=threads), Batch(capes())
    for each in (batch, sound):
        each.start(places(0), settle=0.0)
    before = batch.positions
    poses: list = places(1)
    poses[4] = {"foot": ([0, 0, 0], [1, 0, 0, 0])}
    with pytest.raises(UnknownNameError, match=r"^cape 4: no bone named 'hand'; available: foot"):
        batch.step(poses, 1 / 60)
    sound.step(places(1), 1 / 60)
    for index in range(6):
        expected = before if index == 4 else sound.positions
        np.testing.assert_array_equal(batch.positions[index], expected[index])


def test_a_cape_that_cannot_be_started_is_named():
    poses: list = places(0)
    poses[1] = {"hand": ([np.nan, 0, 0], [1, 0, 0, 0])}
    with pytest.raises(ValueRangeError, match=r"^cape 1: the pose of the bones is not finite"):
        Batch(capes()).start(poses)


def test_what_does_not_fit_a_batch_is_refused():
    simulations = capes()
    with pytest.raises(ValueRangeError, match="listed twice"):
        Batch([simulations[0], simulations[0]])
    with pytest.raises(ValueRangeError, match="threads must be 1 or more, not 0"):
        Batch(simulations, threads=0)
    batch = Batch(simulations)
    with pytest.raises(ValueRangeError, match=r"^cape 0: the simulation has not been started"):
        batch.step(places(0), 1 / 60)
    with pytest.raises(ValueRangeError, match="a pose for each of the 6 capes is needed, not 5"):
        batch.start(places(0, 5))
    with pytest.raises(ValueRangeError, match=r"a velocity for each of the 6 capes is needed, not shape \(5, 3\)"):
        batch.start(places(0), velocities=np.zeros((5, 3)))
    with pytest.raises(ValueRangeError, match=r"a spin for each of the 6 capes is needed, not shape \(2,\)"):
        batch.start(places(0), spins=(0, 1))
    batch.start(places(0), settle=0.0)
    with pytest.raises(ValueRangeError, match=r"^cape 0: the time step must be positive"):
        batch.step(places(0), 0.0)


def test_an_interrupt_leaves_nothing_at_work():
    begun, ended, both = [], [], threading.Barrier(2)

    def act() -> None:
        begun.append(1)
        if len(begun) <= 2:
            both.wait(timeout=30.0)
        if threading.current_thread() is threading.main_thread():
            signal.raise_signal(signal.SIGINT)
        time.sleep(0.03)
        ended.append(1)

    batch = Batch(capes(solver=Observed(act=act)), threads=2)
    batch.start(places(0), settle=0.0)
    with pytest.raises(KeyboardInterrupt):
        batch.step(places(1), 1 / 60)
    # The one that was interrupted, and whatever the other thread had in hand, but not all that was left.
    assert len(ended) == len(begun) - 1 < 4


def test_an_empty_batch_does_nothing():
    batch = Batch([])
    batch.start([])
    batch.step([], 1 / 60)
    assert batch.positions == []
    assert len(batch) == 0


def test_batches_of_several_python_threads_go_side_by_side():
    results = []

    def work() -> None:
        batch = Batch(capes())
        batch.start(places(0), settle=0.0)
        for frame in range(1, 6):
            batch.step(places(frame), 1 / 60)
        results.append(batch.positions)

    threads = [threading.Thread(target=work) for _ in range(3)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert len(results) == 3
    for other in results[1:]:
        for one, two in zip(results[0], other, strict=True):
            np.testing.assert_array_equal(one, two)
