"""Random arrangements of colliders, cloth and motions: nothing stuck, torn loose or not a number.

The first of five hundred; `python tests/contact_judge.py` takes them all.
"""

import pytest
from arrangements import arrangement
from contact_judge import run
from scenes import both_by_default

from cape import Solver

COUNT, CHUNK = 100, 50


@both_by_default
@pytest.mark.parametrize("first", range(0, COUNT, CHUNK))
def test_random_arrangements_go_well(solver: Solver, first: int):
    faults = [fault for number in range(first, first + CHUNK) for fault in run(arrangement(number), solver).faults]
    assert not faults, "\n".join(faults)
