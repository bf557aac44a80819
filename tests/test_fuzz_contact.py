"""Five hundred random arrangements of colliders, cloth and motions: nothing stuck, torn loose or not a number."""

import pytest
from arrangements import COUNT, arrangement
from contact_judge import run
from scenes import both_by_default

from cape import Solver

CHUNK = 50


@both_by_default
@pytest.mark.parametrize("first", range(0, COUNT, CHUNK))
def test_random_arrangements_go_well(solver: Solver, first: int):
    faults = [fault for number in range(first, first + CHUNK) for fault in run(arrangement(number), solver).faults]
    assert not faults, "\n".join(faults)
