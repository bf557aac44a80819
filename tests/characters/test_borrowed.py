"""A figure that takes the animation of another file: it goes where the same body goes that has the animation itself."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import motions
from motions.errors import FileError, UnknownNameError
from tests.characters.builder import body, character
from tests.characters.test_reading import drawn, expected, two_bones
from tests.characters.test_roles import BONES, NAMELESS, VRM

BODY = body()
FRAMES = 12
AXES = Rotation.from_quat(np.random.default_rng(0).normal(size=(len(BODY.names), 4))).as_quat()
VRMA = {"VRMC_vrm_animation": {"humanoid": VRM["VRMC_vrm"]["humanoid"]}}
SAME = 5e-6


@pytest.fixture
def walk(tmp_path):
    """A walk in a file whose bones have names of their own, and VRM's for those."""
    return character(tmp_path / "walk.vrma", BODY, frames=FRAMES, names=NAMELESS, extensions=VRMA)


def test_a_vrm_moves_by_a_vrm_animation_whatever_its_bones_axes(tmp_path, walk):
    hero = character(tmp_path / "hero.vrm", BODY, axes=AXES, extensions={"VRMC_vrm": VRM["VRMC_vrm"]})
    clip = motions.load(hero, animation=str(walk))
    assert clip.frames == FRAMES
    assert any("of walk.vrma, whose 20 bones move" in each for each in clip.decisions)
    # All but the toes are bones of VRM, and they are straight on their feet, as in the walk.
    moving = np.isin(BODY.joints[:, 0], [node - 1 for node in BONES.values()])
    assert np.abs(drawn(clip) - expected(FRAMES))[:, moving].max() < SAME


def test_one_of_version_0_faces_the_other_way(tmp_path, walk):
    half = {"rotation": [0.0, 1.0, 0.0, 0.0]}
    hero = character(tmp_path / "hero.vrm", BODY, axes=AXES, root=half, extensions={"VRM": VRM["VRM"]})
    turn = np.diag([-1.0, 1.0, -1.0, 1.0])
    clip = motions.load(hero, animation=str(walk))
    moving = np.isin(BODY.joints[:, 0], [node - 1 for node in BONES.values()])
    assert np.abs(drawn(clip) - expected(FRAMES, turn))[:, moving].max() < SAME


def test_names_that_both_have_will_do(tmp_path):
    # One that faces +X, in centimetres.
    own = {"scale": [0.01] * 3, "rotation": [0.0, 0.5**0.5, 0.0, 0.5**0.5]}
    source = character(tmp_path / "walk.glb", BODY, frames=FRAMES, unit=0.01, root=own)
    hero = character(tmp_path / "hero.glb", BODY, axes=AXES)
    clip = motions.load(hero, animation=str(source))
    assert np.abs(drawn(clip) - expected(FRAMES)).max() < SAME


def test_roles_will_do(tmp_path, walk):
    hero = character(tmp_path / "hero.glb", BODY, axes=AXES)
    clip = motions.load(hero, animation=str(walk))
    assert any("whose 18 bones" in each for each in clip.decisions)
    both = motions.load(tmp_path / "walk.vrma")
    head = clip.index("mixamorig:Head"), both.index(NAMELESS["mixamorig:Head"])
    apart = clip.world_positions()[:, head[0]] - both.world_positions()[:, head[1]]
    assert np.abs(apart).max() < 0.02  # bones of the spine without a role go along with the next above


def test_longer_legs_make_longer_steps(tmp_path, walk):
    hero = character(tmp_path / "hero.vrm", BODY, axes=AXES, unit=0.5, extensions={"VRMC_vrm": VRM["VRMC_vrm"]})
    clip = motions.load(hero, animation=str(walk), unit="m")
    moving = np.isin(BODY.joints[:, 0], [node - 1 for node in BONES.values()])
    # Twice as large, down to where the feet stand: 3 cm above the floor becomes 6 cm.
    assert np.abs(drawn(clip) - 2.0 * expected(FRAMES))[:, moving].max() < 1e-5


def test_what_moves_nothing_is_refused(tmp_path, walk):
    hero = character(tmp_path / "hero.glb", BODY, axes=AXES)
    still = character(tmp_path / "still.glb", BODY, clips=())
    with pytest.raises(FileError, match="no animation that moves a bone"):
        motions.load(hero, animation=str(still))
    with pytest.raises(FileError, match="moves no bone that is known"):
        motions.load(hero, animation=str(two_bones(tmp_path / "two.glb")))
    with pytest.raises(UnknownNameError, match=r"no animation named 'none.glb'"):
        motions.load(hero, animation="none.glb")
