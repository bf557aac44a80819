"""Fits that are kept on disk: the same as fresh ones, and made anew where anything is different or damaged."""

from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

import motions
from motions.errors import ValueRangeError
from skeleton import Hitboxes, Skeleton, hitboxes_of, kept_hitboxes_of
from skeleton.robot import kept_fits
from skeleton.shapes import Shape
from tests.skeleton.robots import urdf_of

BASE = ['<sphere radius="0.2"/>', '<box size="0.1 0.2 0.3"/>']


@pytest.fixture
def fits(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Tells, by the robots' names, which fits were really made."""
    made: list[str] = []

    def fit(body: Skeleton, **options) -> Hitboxes:
        made.append(body.model.name)
        return hitboxes_of(body, **options)

    monkeypatch.setattr(kept_fits, "hitboxes_of", fit)
    return made


def facts(hitboxes: Hitboxes) -> tuple:
    qualities = {link: asdict(quality) for link, quality in hitboxes.qualities.items()}
    solids = [numbers(solid) for solid in hitboxes.solids]
    return hitboxes.robot, solids, dict(hitboxes.left_out), qualities, hitboxes.decisions


def numbers(solid: Shape) -> tuple:
    values = {key: np.asarray(getattr(solid, key)).tolist() for key in solid.numbers}
    return type(solid), solid.name, solid.bone, solid.friction, solid.thickness, values


def robot(folder: Path, base: list[str] = BASE) -> Skeleton:
    return Skeleton.from_urdf(urdf_of(folder, base))


@pytest.mark.parametrize("options", [{}, {"which": "all"}, {"kind": "tapered_capsule"}])
def test_what_was_kept_is_what_is_fitted_to_the_last_bit(tmp_path: Path, fits: list[str], options: dict):
    fresh = facts(hitboxes_of(robot(tmp_path), **options))
    assert facts(kept_hitboxes_of(robot(tmp_path), tmp_path / "kept", **options)) == fresh
    assert facts(kept_hitboxes_of(robot(tmp_path), tmp_path / "kept", **options)) == fresh
    assert fits == ["two"]


def test_another_robot_and_other_options_are_other_fits(tmp_path: Path, fits: list[str]):
    kept_hitboxes_of(robot(tmp_path), tmp_path)
    kept_hitboxes_of(robot(tmp_path), tmp_path, which="all")
    kept_hitboxes_of(robot(tmp_path), tmp_path, kind="capsule")
    kept_hitboxes_of(robot(tmp_path, [BASE[0], '<box size="0.1 0.2 0.3000001"/>']), tmp_path)
    assert len(fits) == 4


def test_other_sources_fit_anew(tmp_path: Path, fits: list[str], monkeypatch: pytest.MonkeyPatch):
    kept_hitboxes_of(robot(tmp_path), tmp_path)
    monkeypatch.setattr(kept_fits, "_code", lambda: ("other",))
    kept_hitboxes_of(robot(tmp_path), tmp_path)
    assert len(fits) == 2


@pytest.mark.parametrize("suffix", [".toml", ".json"])
@pytest.mark.parametrize("damage", [lambda text: text[:-20], lambda text: text.replace("0.", "1.", 1), lambda _: ""])
def test_a_file_that_is_not_whole_is_written_anew(tmp_path: Path, fits: list[str], suffix: str, damage):
    body = robot(tmp_path)
    first = facts(kept_hitboxes_of(body, tmp_path / "kept"))
    (file,) = (tmp_path / "kept").glob(f"*{suffix}")
    whole = file.read_text()
    file.write_text(damage(whole))
    assert damage(whole) != whole
    for _ in range(2):
        assert facts(kept_hitboxes_of(body, tmp_path / "kept")) == first
    assert len(fits) == 2
    assert file.read_text() == whole


def test_without_a_folder_to_write_to_fits_are_made(tmp_path: Path, fits: list[str]):
    (tmp_path / "file").write_text("")
    for _ in range(2):
        assert kept_hitboxes_of(robot(tmp_path), tmp_path / "file" / "kept").solids
    assert len(fits) == 2


def test_a_clip_s_body_has_capsules_by_proportions_and_nothing_is_kept(tmp_path: Path):
    body = Skeleton.from_clip(motions.load("walk"))
    assert facts(kept_hitboxes_of(body, tmp_path / "kept")) == facts(hitboxes_of(body))
    assert not (tmp_path / "kept").exists()


def test_an_option_that_makes_no_sense_is_refused(tmp_path: Path):
    with pytest.raises(ValueRangeError, match="limbs"):
        kept_hitboxes_of(robot(tmp_path), tmp_path, which="arms")  # type: ignore[arg-type]
