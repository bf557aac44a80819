"""Random arrangements of colliders, cloth and motions: nothing stuck, torn loose or not a number.

`python -m tests.support.contact_judge` tells what happens in each of the five hundred.
"""

import pytest

from cape import Solver, SymplecticEuler
from tests.support.arrangements import arrangement
from tests.support.contact_judge import run
from tests.support.scenes import both_by_default

COUNT, CHUNK, ALL = 20, 10, 500


def faults(solver: Solver, first: int) -> str:
    return "\n".join(
        fault for number in range(first, first + CHUNK) for fault in run(arrangement(number), solver).faults
    )


@both_by_default
@pytest.mark.parametrize("first", range(0, COUNT, CHUNK))
def test_random_arrangements_go_well(solver: Solver, first: int):
    assert faults(solver, first) == ""


@pytest.mark.parametrize("number", [82, 368])
def test_no_corner_is_thrown_off_for_the_sake_of_a_pinched_one(number: int):
    """In these it was: at 1,200 and 1,000 m/s."""
    assert run(arrangement(number), SymplecticEuler()).faults == []


@pytest.mark.extra
@both_by_default
@pytest.mark.parametrize("first", range(COUNT, ALL, CHUNK))
def test_all_random_arrangements_go_well(solver: Solver, first: int):
    assert faults(solver, first) == ""
