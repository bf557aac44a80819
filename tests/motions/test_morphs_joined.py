"""Morph targets where motions are joined, go round, or are steered: weights that are closed forms of the time."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import cape
import motions
from cape.live.character import CharacterSource
from cape.live.keeping import Keeper
from cape.live.rig import Rig
from cape.live.sources import FADE, TrackSource
from motions.skin import Skin, SkinPiece
from skeleton import Skeleton
from skeleton.track import BoneTrack
from tests.characters.test_morphs import MOVES, REST, TRIANGLES

WALK = motions.load("walk").trim(0.0, 1.5)
SHEET = cape.Cloth.rectangle(width=0.4, height=0.4, spacing=0.1)


def face(targets: np.ndarray, *, rest: np.ndarray = REST) -> Skin:
    """A face at the hips, that so many targets move."""
    piece = SkinPiece(
        "Face", rest, None, TRIANGLES, np.zeros((4, 1), int), np.ones((4, 1)),
        targets=targets if len(targets) else None, target_morphs=np.arange(len(targets)) if len(targets) else None,
    )  # fmt: skip
    return Skin((WALK.joints[0],), np.eye(3, 4)[None], (piece,))


def talking(skin: Skin, *weights: float, name: str = "walk") -> motions.Clip:
    """The walk with weights that don't change."""
    return replace(WALK, name=name, skin=skin, morphs=np.tile(weights, (WALK.frames, 1)))


def test_a_clip_that_goes_round_takes_its_weights_along():
    """Weights that are the time go on with it, and in blends steadily back to an earlier one."""
    skin = face(MOVES)
    weights = np.stack([WALK.times, 1.0 - WALK.times, 0.3 + 0.0 * WALK.times], axis=1)
    joined = motions.MotionGraph([replace(WALK, skin=skin, morphs=weights)]).play("walk 0.5s, walk 2.5s")
    assert joined.skin is skin
    assert joined.morphs is not None
    assert joined.frames == 1 + 3.0 * joined.fps
    at, other, still = joined.morphs.T
    assert np.allclose(at + other, 1.0)
    assert np.allclose(still, 0.3)
    steps = joined.fps * np.diff(at)
    assert np.mean(np.isclose(steps, 1.0)) > 0.6
    assert steps.min() > -10.0
    assert steps.max() < 1.0 + 1e-9
    track = Skeleton.from_clip(joined).track(joined)
    assert np.array_equal(track.morphs, joined.morphs)  # pyright: ignore[reportArgumentType]


def test_weights_pass_from_clip_to_clip():
    """Of meshes that were read twice, whose files move other targets: those that both move are one."""
    first, second = talking(face(MOVES[:2]), 1.0, 0.5), talking(face(MOVES[[2, 0]]), 0.2, 3.0, name="again")
    joined = motions.MotionGraph([first, second]).play("walk 0.6s, again 0.6s")
    assert joined.skin is not None
    assert joined.morphs is not None
    piece = joined.skin.pieces[0]
    assert piece.targets is not None
    assert np.array_equal(piece.targets, MOVES)
    assert joined.morphs[0].tolist() == [1.0, 0.5, 0.0]
    assert joined.morphs[-1].tolist() == [3.0, 0.0, 0.2]
    share = (joined.morphs[:, 0] - 1.0) / 2.0  # of the second clip
    assert np.all(np.diff(share) >= 0.0)
    assert 0.0 < share[np.argmax(share > 0.0)] < 0.2
    assert np.allclose(joined.morphs, (1.0 - share[:, None]) * [1.0, 0.5, 0.0] + share[:, None] * [3.0, 0.0, 0.2])


def test_a_clip_without_weights_or_mesh_shows_the_stated_shape():
    for other in (replace(WALK, name="again", skin=face(MOVES)), replace(WALK, name="again")):
        joined = motions.MotionGraph([talking(face(MOVES), 1.0, 2.0, 3.0), other]).play("walk 0.6s, again 0.6s")
        assert joined.morphs is not None
        assert joined.morphs[[0, -1]].tolist() == [[1.0, 2.0, 3.0], [0.0, 0.0, 0.0]]
        assert not any("morph" in each for each in joined.decisions)
    plain = motions.MotionGraph([WALK]).play("walk 0.6s")
    assert (plain.skin, plain.morphs) == (None, None)
    assert motions.MotionGraph([replace(WALK, skin=face(MOVES[:0]))]).play("walk 0.6s").morphs is None


def test_what_another_mesh_has_stays_and_is_told():
    other = talking(face(MOVES, rest=REST + 0.1), 1.0, 2.0, 3.0, name="again")
    graph = motions.MotionGraph([talking(face(MOVES), 1.0, 2.0, 3.0), other])
    joined = graph.play("walk 0.6s, again 0.6s")
    assert joined.morphs is not None
    assert joined.morphs[-1].tolist() == [0.0, 0.0, 0.0]
    (told,) = [each for each in joined.decisions if "morph" in each]
    assert told == "again: its morph targets stay as the file states them, as its mesh is not that of walk"
    joined = graph.play("again 0.6s")
    assert joined.skin is other.skin
    assert joined.morphs is None


def test_a_character_that_is_steered_moves_them():
    skin = face(MOVES[:1])
    clips = [talking(skin, 1.0), talking(face(MOVES[:1]), 3.0, name="again")]
    source = CharacterSource(clips, Skeleton.from_clip(clips[0]), "walk")
    fps = source.walker.fps
    assert source.skin is skin
    seen = []
    for frame in range(150):
        if frame in (30, 34):  # the second within the passage of the first
            source.go("again" if frame == 30 else "walk")
        source.pose((frame + 0.5) / fps)
        seen.append(float(source.morphs[0]))
    assert seen[:29] == pytest.approx([1.0] * 29)
    assert max(seen) > 1.0 + 1e-4
    assert seen[-1] == pytest.approx(1.0)
    assert np.abs(np.diff(seen)).max() < 0.5
    source.go("again")
    source.pose(250 / fps)
    assert source.morphs.tolist() == [3.0]


@pytest.mark.parametrize("root", [True, False])
def test_a_motion_that_is_played_over_and_over_moves_them(root: bool):
    """Weights that are the time: the end fades into the beginning; without a root they go back the way they came."""
    skin, times = face(MOVES[:1]), np.linspace(0.0, 2.0, 121)
    places = np.zeros((121, 1, 3))
    track = BoneTrack(
        (WALK.joints[0],), times, places, np.tile([1.0, 0.0, 0.0, 0.0], (121, 1, 1)),
        roles={"pelvis": WALK.joints[0]} if root else {}, skin=skin, morphs=times[:, None],
    )  # fmt: skip
    source = TrackSource(track)
    assert source.skin is skin
    length, seen = 2.0 - FADE, []
    for time in (0.0, 0.5, length - 0.1, length + FADE / 2.0, length + FADE) if root else (0.0, 0.5, 2.5):
        source.pose(time)
        seen.append(float(source.morphs[0]))
    # Half way through the fade half of the end's and half of the beginning's.
    expected = [0.0, 0.5, length - 0.1, length / 2.0 + FADE / 2.0, FADE] if root else [0.0, 0.5, 1.5]
    assert seen == pytest.approx(expected, abs=1e-9)


def test_a_live_run_keeps_them(tmp_path: Path):
    skin = face(MOVES)
    clip = replace(WALK, skin=skin, morphs=np.stack([WALK.times, 2.0 * WALK.times, 0.0 * WALK.times], axis=1))
    body = Skeleton.from_clip(clip)
    scene = cape.Scene(SHEET, attachments=[cape.attach(SHEET, "pelvis", "top_left")], self_contact=None)
    rig = Rig(scene, TrackSource(body.track(clip)), cape.XPBD(), threads=1)
    rig.start()
    keeper = Keeper(rig, "a", skin=skin)
    for _ in range(5):
        rig.step(0.1)
        keeper.keep()
    take = keeper.take(4)
    assert take.bones.skin is skin
    assert take.bones.morphs == pytest.approx(np.outer(np.arange(4) / 10.0, [1.0, 2.0, 0.0]), abs=1e-9)
    take.keep(tmp_path / "a.npz")
    assert np.array_equal(cape.Take.load(tmp_path / "a.npz").bones.morphs, take.bones.morphs)  # pyright: ignore[reportArgumentType]


def test_a_loop_has_those_of_its_round():
    clip = replace(WALK, skin=face(MOVES[:1]), morphs=WALK.times[:, None]).trim(0.0, 0.4)
    track = Skeleton.from_clip(clip).track(clip)
    scene = cape.Scene(SHEET, attachments=[cape.attach(SHEET, "pelvis", "top_left")], self_contact=None)
    take = cape.simulate(scene, track, solver=cape.XPBD(), loop=True)
    assert take.loop is not None
    assert np.array_equal(take.bones.morphs, track.morphs)  # pyright: ignore[reportArgumentType]
