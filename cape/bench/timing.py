"""Fair timing on a machine whose clock wanders: all variants in turn, again and again, and the least time of each."""

import math
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from cape.kernels import store
from cape.kernels.store import Request


class Probe(ABC):
    """Something to time."""

    units: float
    """What a call works through: vertices times substeps, times capes."""
    requests: Sequence[Request] = ()
    """The code that calls need."""

    @abstractmethod
    def call(self) -> None:
        """Do what is timed."""

    @abstractmethod
    def rewind(self) -> None:
        """Go back to where every repeat starts from."""

    @abstractmethod
    def prepare(self) -> None:
        """Bring everything into the state that repeats start from, after a first call."""


@dataclass(frozen=True)
class Timing:
    """Least time of a probe per unit [ns]; its share of compiling, and what its first call took beyond a later one, to
    load code [s]."""

    ns: float
    compile_s: float


def take_turns(
    probes: Sequence[Probe], *, repeats: int, least: float, told: Callable[[int], Callable[[], None]]
) -> list[Timing]:
    """Time all probes in turn, `repeats` times, and keep the least time of each.

    Args:
        probes: what to time; what they lack is compiled on all cores, then each makes a call that does not count.
        repeats: rounds in which every probe has its turn.
        least: length of a turn [s], filled with as many calls as fit.
        told: called with the number of steps, of which each probe's first call is one and each turn; gives what is
            called after each.
    """
    done = told((1 + repeats) * len(probes))
    compiling, calls = [], []
    for probe, shared in zip(probes, _compile(probes), strict=True):
        first = _seconds(probe, 1)
        probe.prepare()
        probe.rewind()
        second = _seconds(probe, 1)
        compiling.append(shared + max(0.0, first - second))
        calls.append(max(1, math.ceil(least / second)))
        done()
    best = [math.inf] * len(probes)
    for _ in range(repeats):
        for k, probe in enumerate(probes):
            probe.rewind()
            best[k] = min(best[k], _seconds(probe, calls[k]) / calls[k])
            done()
    return [Timing(1e9 * best[k] / probe.units, compiling[k]) for k, probe in enumerate(probes)]


def _compile(probes: Sequence[Probe]) -> list[float]:
    """Compile what probes lack, side by side; gives what it took [s], each one's share by the pieces that are its."""
    known: dict[Request, None] = {}
    counts = []
    for probe in probes:
        before = len(known)
        known.update(dict.fromkeys(store.missing(probe.requests)))
        counts.append(len(known) - before)
    begun = time.perf_counter()
    store.prepare(list(known))
    each = (time.perf_counter() - begun) / max(len(known), 1)
    return [count * each for count in counts]


def _seconds(probe: Probe, calls: int) -> float:
    begun = time.perf_counter()
    for _ in range(calls):
        probe.call()
    return time.perf_counter() - begun
