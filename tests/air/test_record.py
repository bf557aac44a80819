"""A wind from a file: what is read, and what is refused."""

import os
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from cape import UserError, Wind, WindRecord, read_wind


def written(folder: Path, text: str) -> Path:
    path = folder / "wind.csv"
    path.write_text(text)
    return path


def test_a_record_is_read_and_goes_straight_between_its_times(tmp_path: Path):
    record = read_wind(written(tmp_path, "# a mast\ntime,x,y,z\n0, 1, 0, 0\n\n2,3,0,-1\n"))
    np.testing.assert_array_equal(record.times, [0.0, 2.0])
    np.testing.assert_allclose(record.at(0.5), [1.5, 0.0, -0.25])
    np.testing.assert_allclose(record.at(-1.0), [1.0, 0.0, 0.0])
    np.testing.assert_allclose(record.at(9.0), [3.0, 0.0, -1.0])
    wind = Wind(velocity=(0.0, 2.0, 0.0), record=record)
    np.testing.assert_allclose(wind.at(1.0, np.zeros((2, 3))), np.tile([2.0, 2.0, -0.5], (2, 1)))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("", "no line"),
        ("time,x,y,z\n", "no line"),
        ("0,1,2\n", "line 1: expected time, x, y, z"),
        ("0,1,0,0\n1,nan,0,0\n", "line 2"),
        ("0,1,0,0\n1,1e300,0,0\n", "line 2"),
        ("0,1,0,0\n0,1,0,0\n", "line 2: times must rise"),
        ("0,1,0,0\nwind,x,y,z\n", "line 2"),
        ("0,1,0,\x1b[31m0\n", r"\\x1b"),
    ],
)
def test_what_is_no_record_is_refused_with_its_line(tmp_path: Path, text: str, told: str):
    with pytest.raises(UserError, match=told):
        read_wind(written(tmp_path, text))


def test_no_pipe_is_read(tmp_path: Path):
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(UserError):
        read_wind(tmp_path / "pipe")


@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.text(alphabet="0123456789,.-+eEinfa \n#\x00\u0661", max_size=80))
def test_any_text_is_a_record_or_an_error(tmp_path: Path, text: str):
    try:
        record = read_wind(written(tmp_path, text))
    except UserError:
        return
    assert np.isfinite(record.velocities).all()


@pytest.mark.parametrize(
    "wrong",
    [
        {"gusts": -0.1, "velocity": (1.0, 0.0, 0.0)},
        {"gusts": 0.2},
        {"turbulence": float("nan")},
        {"seed": -1},
        {"seed": 1.5},
    ],
)
def test_a_wind_that_cannot_be_is_refused(wrong: dict):
    with pytest.raises(UserError, match=next(iter(wrong))):
        Wind(**wrong)


@pytest.mark.parametrize(
    ("times", "velocities"),
    [([0.0, 0.0], [[1, 0, 0], [1, 0, 0]]), ([0.0], [[1, 0]]), ([], np.zeros((0, 3))), ([0.0], [[np.inf, 0, 0]])],
)
def test_a_record_of_arrays_is_checked(times, velocities):
    with pytest.raises(UserError, match="record"):
        WindRecord(times, velocities)
