"""Clips joined by a script: how alike windows are, how blends keep to the clips' speeds, what a script may say."""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

import motions
from motions import Clip, MotionGraph, Step, UnknownNameError, UserError, ValueRangeError, quaternions
from motions.graph.alignment import window_distances
from motions.graph.blend import TOLERANCE
from tests.support.command import Forks
from tests.support.processes import mistake_told

FloatArray = NDArray[np.float64]

SCRIPT = "idle 2s, walk 3s, run 3s, kick, idle"
SEARCH = 0.5
TOLD = re.compile(
    r"(?P<target>\w+) begins( again)? at (?P<begin>[\d.]+) s: from (?P<source>\w+)'s frame (?P<leave>\d+) to its frame "
    r"(?P<enter>\d+) within (?P<within>[\d.]+) s, at a distance of (?P<distance>[\d.]+) cm; feet slide by "
    r"(?P<slide>[\d.]+) cm(; up to (?P<off>[\d.]+) s off, [^;]*)?"
    r"(; joints are up to (?P<haste>[\d.]+) times as fast as in either.*)?"
)


@pytest.fixture(scope="module")
def shipped() -> dict[str, Clip]:
    return {name: motions.load(name) for name in motions.clip_names()}


@pytest.fixture(scope="module")
def graph(shipped: dict[str, Clip]) -> MotionGraph:
    return MotionGraph(list(shipped.values()))


@pytest.fixture(scope="module")
def shown(graph: MotionGraph) -> Clip:
    return graph.play(SCRIPT)


def told(clip: Clip) -> list[re.Match[str]]:
    """What the decisions say of each blend."""
    return [found for text in clip.decisions if (found := TOLD.fullmatch(text))]


def swaying(name: str, *, fps: float = 60.0, phase: float = 0.0, seconds: float = 4.0, angle: float = 0.3) -> Clip:
    """A root that walks an arc and turns, with two joints that swing; smooth in time."""
    t = np.arange(round(seconds * fps) + 1) / fps
    wave = np.sin(2 * np.pi * t + phase)
    turns = np.stack(
        [
            np.column_stack([0 * t, 0.1 * wave, 0 * t]),
            np.column_stack([angle * wave, 0 * t, 0 * t]),
            np.column_stack([0 * t, angle * np.cos(2 * np.pi * t + phase), 0 * t]),
        ],
        axis=1,
    )
    rotations = quaternions.from_rotation_vector(turns)
    headings = quaternions.from_rotation_vector(np.column_stack([0 * t, 0 * t, 0.4 * t]))
    rotations[:, 0] = quaternions.multiply(headings, rotations[:, 0])
    return Clip(
        name=name,
        joints=("root", "upper", "lower"),
        parents=np.array([-1, 0, 1]),
        offsets=np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 0.5], [0.0, 0.0, 0.4]]),
        end_parents=np.array([2]),
        end_offsets=np.array([[0.0, 0.1, 0.2]]),
        fps=fps,
        root_positions=np.column_stack([np.sin(0.4 * t), 1 - np.cos(0.4 * t), 1 + 0.02 * wave]),
        rotations_wxyz=rotations,
    )


def moved(clip: Clip, heading: float, shift: tuple[float, float]) -> Clip:
    """The same motion elsewhere: turned about +Z [rad], then shifted over the ground [m]."""
    turn = quaternions.from_rotation_vector([0.0, 0.0, heading])
    rotations = clip.rotations_wxyz.copy()
    rotations[:, 0] = quaternions.multiply(turn, rotations[:, 0])
    places = quaternions.rotate(turn, clip.root_positions) + np.array([*shift, 0.0])
    return replace(clip, root_positions=places, rotations_wxyz=rotations)


def positions(clip: Clip) -> FloatArray:
    return clip.world_points()


def speeds(clip: Clip) -> FloatArray:
    """Of joints and end sites in the world [m/s], then of joints about their parents [rad/s], (F - 1, 2 J + E)."""
    q = clip.rotations_wxyz
    # The chord between two unit quaternions is 2 sin(angle / 4).
    spins = 4 * np.arcsin(np.linalg.norm(np.diff(q, axis=0), axis=-1) / 2) * clip.fps
    return np.concatenate([np.linalg.norm(np.diff(positions(clip), axis=0), axis=-1) * clip.fps, spins], axis=1)


def check_speeds(clip: Clip, sources: dict[str, Clip]) -> None:
    """No joint is faster in a blend than anywhere in the two clips, and elsewhere than in the one that plays."""
    limits = {name: speeds(source).max(axis=0) for name, source in sources.items()}
    measured = speeds(clip)
    allowed = np.zeros(measured.shape)
    blends = told(clip)
    names = [blends[0]["source"], *(blend["target"] for blend in blends)] if blends else [clip.name]
    starts = [0, *(round(float(blend["begin"]) * clip.fps) for blend in blends), clip.frames]
    for name, start, end in zip(names, starts, starts[1:], strict=False):
        allowed[start:end] = limits[name]
    for blend, start in zip(blends, starts[1:], strict=False):
        assert blend["haste"] is None
        within = slice(start, start + round(float(blend["within"]) * clip.fps))
        allowed[within] = np.maximum(limits[blend["source"]], limits[blend["target"]])
    excess = (measured - allowed).max(axis=1)
    assert excess.max() <= TOLERANCE + 1e-9, f"by {excess.max():.4f} in frame {excess.argmax()}"


# How alike two windows are


CLOUDS = st.integers(0, 2**32 - 1).map(lambda seed: np.random.default_rng(seed))


@settings(max_examples=50, deadline=None)
@given(CLOUDS, st.floats(-np.pi, np.pi), st.floats(-100, 100), st.floats(-100, 100))
def test_distance_knows_neither_heading_nor_place(random: np.random.Generator, heading: float, x: float, y: float):
    a, b = random.normal(size=(7, 5, 3)), random.normal(size=(6, 5, 3))
    turn = quaternions.from_rotation_vector([0.0, 0.0, heading])
    distances, headings = window_distances(a, b, 4)
    again, turned = window_distances(a, quaternions.rotate(turn, b) + np.array([x, y, 0.0]), 4)
    # Places are rounded to 1e-14 m at 100 m.
    np.testing.assert_allclose(again, distances, atol=1e-11)
    np.testing.assert_allclose(np.exp(1j * turned), np.exp(1j * (headings - heading)), atol=1e-9)
    same, back = window_distances(a, quaternions.rotate(turn, a) + np.array([x, y, 0.0]), 4)
    # A root of a difference that rounds to 1e-15 m2 is 3e-8 m.
    np.testing.assert_allclose(np.diag(same), 0.0, atol=1e-6)
    np.testing.assert_allclose(np.exp(1j * np.diag(back)), np.exp(-1j * heading), atol=1e-6)


@settings(max_examples=20, deadline=None)
@given(CLOUDS)
def test_alignment_is_the_best_of_all(random: np.random.Generator):
    a, b = random.normal(size=(4, 5, 3)), random.normal(size=(5, 5, 3))
    distances, headings = window_distances(a, b, 3)
    for i, j in ((0, 0), (1, 2), (0, 1)):
        angles = np.append(np.linspace(-np.pi, np.pi, 361), headings[i, j])
        turns = quaternions.from_rotation_vector(angles[:, None] * np.array([0.0, 0.0, 1.0]))
        apart = (a[i : i + 3] - quaternions.rotate(turns[:, None, None], b[j : j + 3])).reshape(len(angles), -1, 3)
        apart[..., :2] -= apart[..., :2].mean(axis=1, keepdims=True)
        tried = np.sqrt(np.mean(np.sum(apart**2, axis=-1), axis=1))
        assert distances[i, j] == pytest.approx(tried[-1], abs=1e-9)
        assert tried.min() >= distances[i, j] - 1e-9


def test_height_counts():
    """Only turns about the vertical are free: a body that lies isn't one that stands."""
    points = np.random.default_rng(3).normal(size=(5, 6, 3))
    distances, _ = window_distances(points, points + np.array([3.0, 4.0, 0.25]), 5)
    assert distances[0, 0] == pytest.approx(0.25, abs=1e-9)


def test_a_clip_that_repeats_itself_has_transitions_a_period_apart():
    clip = swaying("sway")
    found = MotionGraph([clip]).transitions("sway", "sway")
    assert [t.distance for t in found] == sorted(t.distance for t in found)
    near = [t for t in found if t.distance < 1e-6]
    # Of a period of 60 frames; in each the path has turned by 0.4 rad.
    assert {abs(t.leave - t.enter) for t in near} == {60, 120, 180}
    for t in near:
        assert t.heading == pytest.approx(0.4 * (t.leave - t.enter) / 60, abs=1e-6)
    assert all(t.frames == 18 for t in found)


# Blends


def test_no_joint_is_faster_in_a_blend_than_in_its_clips(shown: Clip, shipped: dict[str, Clip]):
    assert len(told(shown)) == 4
    check_speeds(shown, shipped)


STEPS = st.builds(Step, st.sampled_from(motions.clip_names()), st.none() | st.floats(0.2, 8.0))


@settings(max_examples=4, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.lists(STEPS, min_size=2, max_size=3))
@example([Step("spin"), Step("idle"), Step("idle")])
@example([Step("idle", 4.53), Step("idle")])
def test_whatever_is_asked_for_no_joint_is_too_fast(graph: MotionGraph, shipped: dict[str, Clip], steps: list[Step]):
    check_speeds(graph.play(steps), shipped)


def test_a_clip_is_left_farther_off_than_asked_where_joints_would_be_too_fast_nearer_by(graph: MotionGraph):
    """The feet of `idle` never move, and stand a little elsewhere from 4 to 5 s than they do at its beginning."""
    (blend,) = told(graph.play("idle 4.53s, idle"))
    assert SEARCH < abs(float(blend["begin"]) - 4.53) <= float(blend["off"])
    assert not blend["haste"]


def test_nothing_jumps(shown: Clip, shipped: dict[str, Clip]):
    """Neither places nor speeds change more from frame to frame than somewhere in the clips."""
    for order in (1, 2):
        changes = [np.abs(np.diff(positions(clip), n=order, axis=0)).max() for clip in (shown, *shipped.values())]
        assert changes[0] <= max(changes[1:]) + 1e-9
    signs = np.sum(shown.rotations_wxyz[1:] * shown.rotations_wxyz[:-1], axis=-1)
    assert signs.min() > 0.9


def test_speeds_have_no_jump_where_clips_are_smooth():
    """With four times the frames the largest change of a velocity is a quarter, seams included: a jump would stay."""
    changes = []
    for fps in (60.0, 240.0):
        clips = [swaying("a", fps=fps, seconds=3.0), swaying("b", fps=fps, seconds=3.0, phase=1.0, angle=0.5)]
        clip = MotionGraph(clips, search=0.1).play("a 1s, b 4s")
        blends = told(clip)
        assert len(blends) >= 2
        assert float(blends[0]["within"]) > 0.35, "the first is drawn out"
        changes.append(np.linalg.norm(np.diff(positions(clip), n=2, axis=0), axis=-1).max() * fps)
    assert changes[1] == pytest.approx(changes[0] / 4, rel=0.1)


def test_feet_that_stand_stay_where_they_are(shown: Clip):
    """Feet's joints near the ground, in each blend: those that stand in both clips slide by less than 3 cm.

    From walk to run it would be 10 cm if the root were blended. Where one foot has to give way it slides farther.
    """
    feet = [shown.index(f"{side}{part}") for side in ("Left", "Right") for part in ("Foot", "ToeBase")]
    at = shown.world_positions()[:, feet]
    low = (at[1:, :, 2] + at[:-1, :, 2]) / 2 < np.quantile(at[..., 2], 0.1, axis=0) + 0.005
    steps = np.linalg.norm(np.diff(at[..., :2], axis=0), axis=-1) * low
    slides = {}
    for blend in told(shown):
        begin = round(float(blend["begin"]) * shown.fps)
        within = slice(begin, begin + round(float(blend["within"]) * shown.fps))
        slides[blend["source"], blend["target"]] = steps[within].sum(axis=0).max()
    assert slides["kick", "idle"] < 0.002
    assert slides["walk", "run"] < 0.03
    assert max(slides.values()) < 0.15


def test_a_joint_that_never_turns_makes_a_blend_as_long_as_allowed_and_is_told():
    """Nothing may turn from one still angle to another: there is no blend slow enough."""
    clips = [swaying("a", angle=0.0), swaying("b", angle=0.0)]
    bent = clips[1].rotations_wxyz.copy()
    bent[:, 2] = quaternions.from_rotation_vector([0.5, 0.0, 0.0])
    clip = MotionGraph([clips[0], replace(clips[1], rotations_wxyz=bent)], longest=1.0).play("a, b")
    (blend,) = told(clip)
    assert float(blend["within"]) == 1.0
    assert blend["haste"]


def test_blends_take_the_time_asked_for(shipped: dict[str, Clip]):
    walk, run = shipped["walk"], shipped["run"]
    for blend in (0.25, 0.5):
        transitions = MotionGraph([walk, run], blend=blend).transitions("walk", "run")
        assert {t.frames for t in transitions} == {round(60 * blend)}
    (loop, *_) = told(MotionGraph([walk], blend=0.5).play("walk 6s"))
    assert float(loop["within"]) == 0.5


# Scripts, played


def test_parts_last_as_long_as_asked(shown: Clip, graph: MotionGraph):
    begins = [0.0, *(float(blend["begin"]) for blend in told(shown))]
    lasted = np.diff(begins)
    assert np.abs(lasted[:3] - [2, 3, 3]).max() <= SEARCH + 0.01
    kick, blends = graph.clips[motions.clip_names().index("kick")], told(shown)
    assert int(blends[2]["enter"]) <= 60 * float(blends[2]["within"])
    assert int(blends[3]["leave"]) + 2 * 60 * float(blends[3]["within"]) >= kick.frames - 1
    assert shown.duration == pytest.approx(begins[-1] + 359 / 60 - int(blends[3]["enter"]) / 60, abs=0.01)


def test_decisions_and_name_tell_the_script(shown: Clip):
    assert shown.name == "idle-walk-run-kick-idle"
    assert [(blend["source"], blend["target"]) for blend in told(shown)] == [
        ("idle", "walk"),
        ("walk", "run"),
        ("run", "kick"),
        ("kick", "idle"),
    ]
    assert "idle begins at 0.00 s with its frame 0" in shown.decisions
    assert any(text.startswith("run: unit: cm") for text in shown.decisions)


def test_parts_of_one_clip_that_follow_each_other_are_one(graph: MotionGraph):
    apart, whole = graph.play("idle 1s, idle 1500ms"), graph.play("idle 2.5s")
    assert (apart.name, apart.duration) == ("idle", 2.5)
    np.testing.assert_array_equal(apart.rotations_wxyz, whole.rotations_wxyz)


def test_frames_away_from_the_blends_are_those_of_the_clips(shown: Clip, shipped: dict[str, Clip]):
    blends = told(shown)
    walk, into, out = shipped["walk"], blends[0], blends[1]
    first = round((float(into["begin"]) + float(into["within"])) * 60)
    last = round(float(out["begin"]) * 60)
    end = int(out["leave"])
    begin = end - (last - first)
    np.testing.assert_allclose(
        shown.rotations_wxyz[first : last + 1, 1:], walk.rotations_wxyz[begin : end + 1, 1:], atol=1e-12
    )
    heights = shown.root_positions[first : last + 1, 2]
    np.testing.assert_allclose(heights, walk.root_positions[begin : end + 1, 2], atol=1e-12)


def test_a_clip_that_is_too_short_goes_round_and_on(graph: MotionGraph, shipped: dict[str, Clip]):
    clip, walk = graph.play("walk 12s"), shipped["walk"]
    assert clip.duration == pytest.approx(12.0, abs=1e-9)
    assert all(blend["source"] == blend["target"] == "walk" for blend in told(clip))
    assert len(told(clip)) >= 2
    # The pace of whole strides, wherever it is measured.
    pace = float(walk.root_positions[-1, 0] - walk.root_positions[0, 0]) / walk.duration
    way = clip.root_positions[-1] - clip.root_positions[0]
    assert math.hypot(way[0], way[1]) == pytest.approx(12.0 * pace, rel=0.02)
    check_speeds(clip, shipped)
    check_speeds(graph.play("kick 9s"), shipped)


def test_where_clips_stand_and_face_is_nothing_to_the_result(shown: Clip, shipped: dict[str, Clip]):
    clips = [moved(clip, 0.7 * k, (3.0 * k, -k)) for k, clip in enumerate(shipped.values()) if clip.name != "idle"]
    again = MotionGraph([shipped["idle"], *clips]).play(SCRIPT)
    np.testing.assert_allclose(again.world_positions(), shown.world_positions(), atol=1e-9)


def test_the_same_script_gives_the_same_bits(graph: MotionGraph, shipped: dict[str, Clip]):
    script = "walk 6s, kick 1s"
    one, other = graph.play(script), MotionGraph([shipped["walk"], shipped["kick"]]).play(motions.parse_script(script))
    assert one.rotations_wxyz.tobytes() == other.rotations_wxyz.tobytes()
    assert one.root_positions.tobytes() == other.root_positions.tobytes()
    assert one.decisions == other.decisions


def test_frame_rates_are_made_one():
    clips = [swaying("a", fps=30.0), swaying("b", fps=60.0)]
    assert MotionGraph(clips).play("a, b").fps == 60.0
    slower = MotionGraph(clips, fps=20.0)
    assert {clip.fps for clip in slower.clips} == {20.0}
    assert slower.play("a 1s").frames == 21


def test_joints_that_move_in_their_parents_are_blended_too():
    """A neck that is drawn out by 5 cm in one clip, while the other has none of its own positions."""
    long = swaying("long")
    local = np.repeat(long.offsets[None], long.frames, axis=0)
    local[:, 0], local[:, 2, 2] = long.root_positions, 0.45
    clip = MotionGraph([swaying("plain"), replace(long, local_positions=local)]).play("plain, long")
    assert clip.local_positions is not None
    lengths = clip.local_positions[:, 2, 2]
    assert (lengths[0], lengths[-1]) == (0.4, 0.45)
    # The steepest slope of the weight over the 18 frames of the shortest blend is 15/8.
    assert np.diff(lengths).min() >= 0.0
    assert np.diff(lengths).max() <= 15 / 8 * 0.05 / 18
    np.testing.assert_array_equal(clip.local_positions[:, 0], clip.root_positions)
    assert MotionGraph([swaying("plain")]).play("plain").local_positions is None


def test_real_motion_goes_round(mocap: Path):
    clip = motions.load(mocap / "ad_cmu1_jumping_jacks.bvh", name="jacks")
    longer = MotionGraph([clip]).play("jacks 9s")
    assert longer.duration == pytest.approx(9.0, abs=0.02)
    check_speeds(longer, {"jacks": clip})


# What is refused


def test_unknown_clips_are_named_with_their_part_and_what_there_is(graph: MotionGraph):
    with pytest.raises(UnknownNameError, match=r"'walkk'; available: idle, jump.*part 2 .* 'walkk 3s'"):
        graph.play("idle, walkk 3s")
    with pytest.raises(UnknownNameError, match="walkk"):
        graph.transitions("idle", "walkk")
    with pytest.raises(UserError, match="no part"):
        graph.play([])


def test_other_skeletons_are_named_with_what_differs():
    clip = swaying("a")
    other = replace(clip, name="b")
    far = clip.offsets + np.array([[0, 0, 0], [0, 0, 0], [0.02, 0, 0]])
    cases = {
        r"'b'.* lacks the joint 'lower'": replace(other, joints=("root", "upper", "tail")),
        r"'b'.* another order": replace(other, joints=("root", "lower", "upper")),
        r"'lower' hangs at 'root', not at 'upper'": replace(other, parents=np.array([-1, 0, 0])),
        r"'lower' is 0\.020 m away": replace(other, offsets=far),
        r"end sites at upper, not at lower": replace(other, end_parents=np.array([1])),
        r"end site of 'lower' is 0\.100 m": replace(other, end_offsets=clip.end_offsets + np.array([0, 0, 0.1])),
    }
    for text, changed in cases.items():
        with pytest.raises(ValueRangeError, match=text):
            MotionGraph([clip, changed])
    MotionGraph([clip, replace(other, offsets=clip.offsets + np.array([[0, 0, 0], [0, 0, 0], [5e-4, 0, 0]]))])


def test_numbers_out_of_range_are_refused():
    clip = swaying("a")
    with pytest.raises(ValueRangeError, match="at least one"):
        MotionGraph([])
    with pytest.raises(ValueRangeError, match="given twice: 'a'"):
        MotionGraph([clip, clip])
    with pytest.raises(ValueRangeError, match=r"'a' lasts 4\.00 s, too short"):
        MotionGraph([clip], blend=1.5)
    with pytest.raises(ValueRangeError, match="shorter than the shortest"):
        MotionGraph([clip], blend=1.0, longest=0.5)
    for name in ("blend", "longest", "search", "fps"):
        for value in (0.0, -1.0, math.nan, math.inf):
            with pytest.raises(ValueRangeError, match=name):
                MotionGraph([clip], **{name: value})


# Scripts, read


NAMES = st.text(min_size=1, max_size=12) | st.text(alphabet='ab 13.s,"\n', min_size=1, max_size=8)
TIMES = st.none() | st.floats(0.0, 3600.0, exclude_min=True)


@settings(max_examples=150, deadline=None)
@given(st.lists(st.builds(Step, NAMES, TIMES), min_size=1, max_size=4))
def test_a_script_that_is_written_is_read_as_it_was(steps: list[Step]):
    assert motions.parse_script(motions.format_script(steps)) == tuple(steps)


@settings(max_examples=300, deadline=None)
@given(st.text(max_size=40) | st.text(alphabet='walk 0123.,ms"-+\t', max_size=40))
def test_whatever_is_written_is_read_or_refused(text: str):
    try:
        steps = motions.parse_script(text)
    except UserError:
        return
    assert motions.parse_script(motions.format_script(steps)) == steps


def test_times_may_be_written_in_several_ways():
    for text in ("walk 0.5", "walk .5s", "walk 500ms", "walk 500 ms", " walk\t0.5 s ", '"walk"0.5s'):
        assert motions.parse_script(text) == (Step("walk", 0.5),), text
    assert motions.parse_script('my walk.bvh, "3s", "a,""b""" 2s, take 01.bvh') == (
        Step("my walk.bvh"),
        Step("3s"),
        Step('a,"b"', 2.0),
        Step("take 01.bvh"),
    )


UNREADABLE = {
    "": "part 1 .*missing",
    "idle, , walk": "part 2 .*missing",
    "idle 2s,": "part 2 .*missing",
    "idle, 3s": "part 2 .*'3s'.*missing",
    "walk 3x": "part 1 .*'walk 3x'.*'3x' is no time.*500ms",
    "idle, walk -3s": "part 2 .*'-3s' is no time",
    "walk 0s": "part 1 .*above 0 s",
    "walk 99999s": "part 1 .*at most 3600 s",
    'idle, "walk 3s': "part 2 .*double quote",
    'a "walk"': "part 1 .*double quote",
}


@pytest.mark.parametrize("text", UNREADABLE)
def test_errors_point_to_the_part(text: str):
    with pytest.raises(UserError, match=UNREADABLE[text]):
        motions.parse_script(text)


# The command


def test_the_command_joins_shipped_clips_and_files(tmp_path: Path, forks: Forks):
    motions.save(motions.load("walk"), tmp_path / "my walk.bvh")
    done = forks("hitboxes", "--bare", "--script", "idle 1s, my walk.bvh 1s", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["idle-my walk_hitboxes.rrd", "my walk.bvh"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["replay", "walk", "--script", "idle"], "either CLIP (walk) or --script"),
        (["hitboxes"], "CLIP or a --script"),
        (["replay", "--script", "idle, walkk 3s"], "part 2 of the script, 'walkk 3s': no file 'walkk'; shipped clips:"),
        (["replay", "--script", "idle 3x"], "'3x' is no time"),
    ],
)  # fmt: skip
def test_a_mistaken_script_is_one_line_and_status_2(arguments: list[str], words: str, tmp_path: Path, forks: Forks):
    done = forks(*arguments, folder=tmp_path)
    said, line = mistake_told(done)
    assert said == []
    assert words in line
