"""Takes that are kept are read again as they were, whatever fields they have; what is damaged ends in a line."""

import json
import zipfile
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from pathlib import Path

import numpy as np
import pytest

import cape
from cape.cloth.cloth import Cloth
from cape.results import take_file
from cape.results.take import Take
from motions.errors import FileError, ValueRangeError
from tests.exports.a_take import difference, make_take


@pytest.fixture(scope="module")
def kept_and_read(tmp_path_factory: pytest.TempPathFactory) -> tuple[Take, Take]:
    path, take = tmp_path_factory.mktemp("kept") / "take.npz", make_take()
    take.keep(path)
    return take, cape.Take.load(path)


@pytest.mark.parametrize("field", [each.name for each in fields(Take)])
def test_each_field_is_read_as_it_was_kept(field: str, kept_and_read: tuple[Take, Take]):
    take, read = (getattr(each, field) for each in kept_and_read)
    assert difference(take, read, field) == ""


@dataclass(frozen=True, eq=False)
class Detail:
    """What a field to come may hold."""

    frame: int
    numbers: np.ndarray


@dataclass(frozen=True, eq=False)
class LaterTake(Take):
    """A take with a field more."""

    parts: tuple[Detail, ...] | None = None


def test_a_field_to_come_needs_no_line(tmp_path: Path):
    take = make_take()
    own = {each.name: getattr(take, each.name) for each in fields(take)}
    later = LaterTake(**own, parts=(Detail(3, np.arange(40).reshape(20, 2)), Detail(5, np.zeros((0, 2)))))
    later.keep(tmp_path / "take.npz")
    assert difference(later, Take.load(tmp_path / "take.npz")) == ""


def test_least_of_a_take_and_a_mesh_cloth(tmp_path: Path):
    skirt = Cloth.skirt(spacing=0.1)
    take = replace(
        make_take(), cloth=skirt, contacts=None, loop=None, step_errors=(), colliders=[], held=np.zeros(0, int)
    )
    take.keep(tmp_path / "take.npz")
    assert difference(take, Take.load(tmp_path / "take.npz")) == ""


def test_what_no_field_allows_is_refused_and_leaves_the_file_as_it_was(tmp_path: Path):
    path = tmp_path / "take.npz"
    path.write_text("as it was")
    with pytest.raises(ValueRangeError, match=r"take\.left_out\.a can't be kept: it is of the type complex"):
        replace(make_take(), left_out={"a": 1j}).keep(path)  # pyright: ignore[reportArgumentType]
    with pytest.raises(FileError, match="can't write"):
        make_take().keep(tmp_path / "nowhere" / "take.npz")
    assert [each.name for each in tmp_path.iterdir()] == ["take.npz"]
    assert path.read_text() == "as it was"


def test_a_take_too_large_to_be_read_again_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(take_file, "LARGEST_FILE", take_file.ROOM + 5000)
    with pytest.raises(ValueRangeError, match="MB can't be kept"):
        make_take().keep(tmp_path / "take.npz")


def test_files_that_hold_no_take_say_what_they_are(tmp_path: Path):
    recording = tmp_path / "walk.rrd"
    recording.write_bytes(b"RRF2")
    with pytest.raises(FileError, match=r"is a recording.* cape replay CLIP -o walk\.npz"):
        Take.load(recording)
    np.savez(tmp_path / "motion.npz", q=np.zeros(3))
    with pytest.raises(FileError, match="holds no take: there is no text named 'take'"):
        Take.load(tmp_path / "motion.npz")
    with pytest.raises(FileError, match="can't read"):
        Take.load(tmp_path / "missing.npz")


def changed(path: Path, **fields_: object) -> None:
    """Give fields of a kept take other values."""
    with np.load(path) as archive:
        arrays = dict(archive)
    content = json.loads(arrays["take"].item())
    content["take"]["fields"] |= fields_
    arrays["take"] = np.array(json.dumps(content).encode())
    np.savez(path, allow_pickle=False, **arrays)


@pytest.mark.parametrize(
    ("field", "value", "told"),
    [
        ("name", 5, "name is a int"),
        ("bones", None, "bones is a NoneType"),
        ("positions", {"array": "gone"}, "gone"),
        ("positions", {"array": "take.triangles"}, r"positions must be numbers of the shape \(7, 30, 3\)"),
        ("triangles", {"numbers": [[0, 1, 30]], "of": "<i4"}, "a vertex that is not among the 30"),
        ("triangles", {"numbers": [[0, 1, "x"]], "of": "|O"}, "triangles must be numbers"),
        ("cloth", {"is": "Popen", "fields": {"args": "true"}}, "no class named 'Popen'; available: Take, "),
        ("cloth", {"is": "Fabric", "fields": {}}, "cloth is a Fabric"),
        ("colliders", {"tuple": [1]}, "a collider is of another type"),
        ("loop", {"from": 1}, "nothing is told by 'from'"),
        ("unheard_of", 1, "unheard_of"),
    ],
)
def test_a_text_that_makes_no_sense_ends_in_a_line(field: str, value: object, told: str, tmp_path: Path):
    path = tmp_path / "take.npz"
    make_take().keep(path)
    changed(path, **{field: value})
    with pytest.raises(FileError, match=f"holds no take that this version of cape .* can read: .*{told}"):
        Take.load(path)


def test_damaged_files_end_in_a_line(tmp_path: Path):
    path, take = tmp_path / "take.npz", make_take()
    take.keep(path)
    whole = path.read_bytes()
    rng = np.random.default_rng(6)
    for damaged in [whole[:n] for n in (0, 100, len(whole) // 2, len(whole) - 1)]:
        path.write_bytes(damaged)
        with pytest.raises(FileError):
            Take.load(path)
    for place in rng.integers(0, len(whole), 60):
        path.write_bytes(whole[:place] + bytes([whole[place] ^ 0xFF]) + whole[place + 1 :])
        with suppress(FileError):  # where nothing is read, such as dates, a file may be other than it was
            assert difference(take, Take.load(path)) == ""


def test_nothing_is_pickled(tmp_path: Path):
    path = tmp_path / "take.npz"
    make_take().keep(path)
    with zipfile.ZipFile(path) as archive:
        heads = [archive.read(name)[:128] for name in archive.namelist()]
    assert heads
    assert not any(b"'|O'" in head for head in heads)
