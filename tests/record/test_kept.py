"""What a long run leaves is kept on disk, and is the same numbers."""

import errno
import tempfile
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import cape
from cape.results import kept as module
from cape.results.kept import Kept, blocks, let_go
from skeleton.track import BoneTrack

ROWS = np.arange(60, dtype=np.float32).reshape(20, 3)


def is_on_disk(kept: Kept) -> bool:
    return kept._file is not None


@given(st.lists(st.integers(0, 7), max_size=12), st.integers(0, 400), st.integers(0, 40))
def test_rows_are_the_same_in_memory_and_on_disk(counts: list[int], room: int, count: int):
    kept, expected = Kept((3,), np.float32), np.zeros((0, 3), np.float32)
    kept._most = room
    for n in counts:
        rows = np.random.default_rng(len(expected)).normal(size=(n, 3)).astype(np.float32)
        kept.add(rows)
        expected = np.concatenate([expected, rows])
        assert len(kept) == len(expected)
        assert is_on_disk(kept) == (12 * len(expected) > room)
    np.testing.assert_array_equal(kept.array(), expected)
    kept.cut(count)
    kept.add(ROWS)
    np.testing.assert_array_equal(kept.array(), np.concatenate([expected[:count], ROWS]))


def test_what_is_let_go_of_keeps_its_numbers_also_those_that_were_changed(monkeypatch: pytest.MonkeyPatch):
    kept = Kept((3,), np.float32)
    kept._most = 0
    kept.add(ROWS)
    array = kept.array()[2:]
    array[0] = -1.0
    let_go(array)
    np.testing.assert_array_equal(array[0], -1.0)
    np.testing.assert_array_equal(array[1:], ROWS[3:])
    monkeypatch.setattr(module, "BLOCK", 5 * 12)
    assert [(b.start, b.stop) for b in blocks(array)] == [(0, 5), (5, 10), (10, 15), (15, 18)]
    assert list(blocks(array[:0])) == []


@pytest.mark.parametrize("room", [0, 30, 100, 106])
@pytest.mark.parametrize("each", [1, 3])
def test_a_full_disk_loses_nothing(room: int, each: int, monkeypatch: pytest.MonkeyPatch):
    """It takes what there is room for [bytes], a part of a row as well, and tells with what comes next."""

    def small(**_):
        file = open_file(buffering=0)
        write = file.write

        def limited(data):
            left = room - file.tell()
            if left <= 0:
                raise OSError(errno.ENOSPC, "No space left on device")
            return write(bytes(data)[:left])

        return SimpleNamespace(write=limited, seek=file.seek, read=file.read, flush=file.flush, fileno=file.fileno)

    open_file = tempfile.TemporaryFile
    monkeypatch.setattr(module.tempfile, "TemporaryFile", small)
    kept = Kept((3,), np.float32)
    kept._most = 50
    for first in range(0, len(ROWS), each):
        kept.add(ROWS[first : first + each])
    assert not is_on_disk(kept)
    np.testing.assert_array_equal(kept.array(), ROWS)


def test_a_take_is_the_same_when_it_is_on_disk(tmp_path, monkeypatch: pytest.MonkeyPatch):
    sheet = cape.Cloth.rectangle(width=1.0, height=1.0, spacing=0.25)
    ball = cape.Sphere(name="ball", bone=None, center=np.array([0.0, 0.0, -0.5]), radius=0.3)
    scene = cape.Scene(sheet, [cape.attach(sheet, "rod", "top")], [ball])
    places = np.zeros((30, 1, 3))
    places[:, 0, 0] = 0.2 * np.sin(0.3 * np.arange(30))
    track = BoneTrack(("rod",), np.arange(30) / 60, places, np.tile([1.0, 0.0, 0.0, 0.0], (30, 1, 1)))
    here = cape.simulate(scene, track)
    monkeypatch.setattr(module, "IN_MEMORY", 30)
    there = cape.simulate(scene, track)
    assert here.contacts is not None
    assert len(here.contacts.points) > 3
    np.testing.assert_array_equal(there.positions, here.positions)
    for name in ("starts", "points", "normals", "depths", "colliders", "vertices"):
        np.testing.assert_array_equal(getattr(there.contacts, name), getattr(here.contacts, name))
    sizes = []
    for take in (here, there):
        take.save(tmp_path / "take.rrd")
        sizes.append((tmp_path / "take.rrd").stat().st_size)
    assert sizes[0] == pytest.approx(sizes[1], rel=0.01)
