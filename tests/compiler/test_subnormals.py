"""Numbers below the smallest with all its digits: zero within compiled code, on every thread, and nowhere else."""

import threading
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from cape.kernels.jit import routine, unit
from cape.kernels.linking import Linker
from cape.kernels.program import Use
from cape.kernels.team import Team
from tests.support.code import MACHINE, compiled_only

pytestmark = [compiled_only, pytest.mark.skipif(MACHINE != "x86_64", reason="its processor does not mind them")]

kinds = pytest.mark.parametrize("kind", [np.float32, np.float64])


@routine
def halve(numbers):
    for k in range(numbers.size):
        numbers[k] = numbers[k] / 2


@routine
def halved(number):
    return number / 2


class Numbers(NamedTuple):
    numbers: NDArray[np.floating]


@unit
def halve_unit(g, team, substep, substeps, step):
    for k in range(g.numbers.size):
        g.numbers[k] = g.numbers[k] / 2


def series(kind: type[np.floating]) -> NDArray[np.floating]:
    """Subnormal numbers, one that becomes so by halving, the smallest that does not, and ordinary ones."""
    tiny = np.finfo(kind).tiny
    return np.array([np.finfo(kind).smallest_subnormal, -tiny / 2, -1.5 * tiny, 2 * tiny, 1.0, -3.0], kind)


def expected(kind: type[np.floating]) -> NDArray[np.floating]:
    return np.array([0, 0, 0, np.finfo(kind).tiny, 0.5, -1.5], kind)


def require_untouched(kind: type[np.floating]) -> None:
    """Python's own thread halves them as IEEE 754 says."""
    assert (series(kind)[:3] / kind(2))[2] != 0
    assert np.nextafter(kind(0), kind(1)) * kind(1) != 0


@kinds
def test_they_count_as_zero_within_a_call(kind):
    numbers = series(kind)
    halve(numbers)
    assert numbers.tolist() == expected(kind).tolist()
    require_untouched(kind)


def test_what_a_call_returns_is_the_same_as_without():
    assert halved(3.0) == 1.5
    assert halved(5e-324) == 0
    require_untouched(np.float64)


@kinds
def test_they_count_as_zero_in_frames_on_any_thread(kind):
    linker, several = Linker(), [series(kind) for _ in range(3)]
    frames = [linker.frame([], [Use(halve_unit, Numbers(numbers))], Team.alone(numbers.size)) for numbers in several]
    linker.link()
    frames[0].run(1, 1.0)
    threads = [threading.Thread(target=frame.run, args=(1, 1.0)) for frame in frames[1:]]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for numbers in several:
        assert numbers.tolist() == expected(kind).tolist()
    require_untouched(kind)
