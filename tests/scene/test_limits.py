"""Scenes and files that ask for more than there is room for are refused, or drawn in part, and said so."""

import numpy as np
import pytest

import cape
from cape.record.solids import drawable
from motions.errors import FileError, ValueRangeError
from motions.limits import MOST_COLLIDERS, MOST_DRAWN
from skeleton.robot.solid_files import read_solids

SHEET = cape.Cloth.rectangle(width=1.0, height=1.0, spacing=0.5)
BALL = cape.Sphere(name="ball", bone=None, center=np.zeros(3), radius=0.1)
TABLE = '[[solid]]\nname = "{}"\nkind = "sphere"\ncenter = [0.0, 0.0, 0.0]\nradius = 0.1\n'


def test_colliders_beyond_the_limit_are_refused_by_a_scene_and_by_a_file(tmp_path, monkeypatch: pytest.MonkeyPatch):
    with pytest.raises(ValueRangeError, match=f"at most {MOST_COLLIDERS} colliders, not 100001"):
        cape.Scene(SHEET, colliders=[BALL] * 100_001)
    monkeypatch.setattr("skeleton.robot.solid_files.MOST_COLLIDERS", 4)
    path = tmp_path / "solids.toml"
    path.write_text("".join(TABLE.format(k) for k in range(4)))
    assert len(read_solids(path)[1]) == 4
    path.write_text("".join(TABLE.format(k) for k in range(5)))
    with pytest.raises(FileError, match="holds 5 solids, more than 4"):
        read_solids(path)
    monkeypatch.setattr("skeleton.robot.solid_files.LARGEST_MARKUP", 100)
    with pytest.raises(FileError, match="has 0 MB, more than"):
        read_solids(path)


def test_many_colliders_with_names_of_their_own_are_looked_at_once():
    balls = [cape.Sphere(name=f"ball {k}", bone=None, center=np.zeros(3), radius=0.1) for k in range(2000)]
    assert len(cape.Scene(SHEET, colliders=balls).colliders) == 2000
    with pytest.raises(ValueRangeError, match="two colliders are named 'ball 7'"):
        cape.Scene(SHEET, colliders=[*balls[:-1], balls[7]])


def test_a_recording_draws_all_capsules_and_as_many_others_as_it_has_room_for():
    capsule = cape.Capsule("limb", None, np.zeros(3), np.ones(3), 0.1)
    balls = [BALL] * MOST_DRAWN
    assert drawable([*balls, capsule]) == [*balls, capsule]
    with pytest.warns(UserWarning, match=f"{MOST_DRAWN} of {MOST_DRAWN + 1} colliders that are no capsules"):
        drawn = drawable(
            [*(cape.Sphere(name="other", bone=None, center=np.zeros(3), radius=0.1) for _ in balls), BALL, capsule]
        )
    assert len(drawn) == MOST_DRAWN + 1
    assert drawn[-1] is capsule
