"""BVH files: every way in which real ones differ, every way in which broken ones break, and back to text."""

import re
from dataclasses import replace
from itertools import permutations
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import motions
from motions import Clip, FileError, UnknownNameError, ValueRangeError, quaternions

# Twelve digits of numbers around 100 file units of 1 cm.
WRITTEN = 1e-9

PERSON = """HIERARCHY
ROOT Hips
{
  OFFSET 0 0 0
  CHANNELS 6 Xposition Yposition Zposition Zrotation Yrotation Xrotation
  JOINT Chest
  {
    OFFSET 0 45 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    JOINT Head
    {
      OFFSET 0 15 2
      CHANNELS 3 Zrotation Xrotation Yrotation
      End Site
      {
        OFFSET 0 20 0
      }
    }
  }
  JOINT LeftUpLeg
  {
    OFFSET 10 0 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    JOINT LeftLeg
    {
      OFFSET 0 -42 0
      CHANNELS 1 Xrotation
      JOINT LeftFoot
      {
        OFFSET 0 -42 0
        CHANNELS 0
        End Site
        {
          OFFSET 0 -5 12
        }
      }
    }
  }
  JOINT RightUpLeg
  {
    OFFSET -10 0 0
    CHANNELS 3 Zrotation Xrotation Yrotation
    JOINT RightLeg
    {
      OFFSET 0 -42 0
      CHANNELS 2 Xrotation Yrotation
      JOINT RightFoot
      {
        OFFSET 0 -42 0
        End Site
        {
          OFFSET 0 -5 12
        }
      }
    }
  }
}
MOTION
Frames: 4
Frame Time: 0.0333333
0 90 0 0 0 0 0 0 0 0 0 0 10 0 0 5 -10 0 0 5 1
1 90.5 2 1 2 3 2 0 0 0 1 0 9 1 0 7 -9 0 0 6 2
2 91 4 2 4 6 4 0 0 0 2 0 8 2 0 9 -8 0 0 7 3
3 90.5 6 3 6 9 6 0 0 0 3 0 7 3 0 11 -7 0 0 8 4
"""
LINES = PERSON.split("\n")
FIRST_ROW = LINES.index("MOTION") + 3


def write(folder: Path, text: str | bytes, name: str = "clip.bvh") -> Path:
    path = folder / name
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return path


def assert_same_motion(a: Clip, b: Clip, tolerance: float = WRITTEN) -> None:
    assert a.joints == b.joints
    np.testing.assert_array_equal(a.parents, b.parents)
    np.testing.assert_array_equal(a.end_parents, b.end_parents)
    np.testing.assert_allclose(a.offsets, b.offsets, atol=tolerance)
    np.testing.assert_allclose(a.end_offsets, b.end_offsets, atol=tolerance)
    assert a.fps == pytest.approx(b.fps, rel=1e-12)
    np.testing.assert_allclose(a.root_positions, b.root_positions, atol=tolerance)
    np.testing.assert_allclose(np.abs(np.sum(a.rotations_wxyz * b.rotations_wxyz, axis=-1)), 1, atol=tolerance)
    np.testing.assert_allclose(
        quaternions.to_matrix(a.rotations_wxyz), quaternions.to_matrix(b.rotations_wxyz), atol=tolerance
    )
    assert (a.local_positions is None) == (b.local_positions is None)
    if a.local_positions is not None and b.local_positions is not None:
        np.testing.assert_allclose(a.local_positions, b.local_positions, atol=tolerance)


def test_numbers_of_a_file_arrive_in_metres_and_z_up(tmp_path):
    clip = motions.load(write(tmp_path, PERSON))
    assert clip.name == "clip"
    assert (clip.frames, clip.fps) == (4, 30.0)
    np.testing.assert_allclose(clip.root_positions[1], [0.01, -0.02, 0.905], atol=1e-15)
    np.testing.assert_allclose(clip.offsets[clip.index("Head")], [0, -0.02, 0.15], atol=1e-15)
    assert clip.parents.tolist() == [-1, 0, 1, 0, 3, 4, 0, 6, 7]
    assert clip.end_parents.tolist() == [2, 5, 8]
    # Z, then Y, then X of the file, which are -Y, Z and X of the world after the quarter turn about X.
    angles = np.deg2rad([3, 6, 9]) * [-1, 1, 1]
    np.testing.assert_allclose(clip.rotations_wxyz[3, 0], quaternions.from_euler(angles, "yzx"), atol=1e-15)
    np.testing.assert_allclose(clip.rotations_wxyz[0, clip.index("RightFoot")], [1, 0, 0, 0])
    assert [sentence.split(":")[0] for sentence in clip.decisions] == ["up", "unit"]
    assert "cm" in clip.decisions[1]


WRITINGS = {
    "CRLF": PERSON.replace("\n", "\r\n"),
    "CR": PERSON.replace("\n", "\r"),
    "tabs": PERSON.replace("  ", "\t").replace(" ", "\t"),
    "byte order mark": "\ufeff" + PERSON,
    "doubled and trailing blanks": PERSON.replace(" ", "  ").replace("\n", " \t \n"),
    "blank lines": PERSON.replace("\n", "\n\n"),
    "brace on the same line": re.sub(r"\n *\{", " {", PERSON),
    "brace without a blank": re.sub(r"\n *\{", "{", PERSON),
    "name of an end site": PERSON.replace("End Site", "End LeftToe_End and more"),
    "end site without a name": PERSON.replace("End Site", "End"),
    "wrapped frames": "\n".join(
        LINES[:FIRST_ROW] + [re.sub(r"^((?:\S+ ){7})", r"\1\n", line) for line in LINES[FIRST_ROW:]]
    ),
    "scientific notation": PERSON.replace("90.5", "9.05e+1").replace(" 45 ", " 4.5E1 ").replace(" -5 ", " -50.e-1 "),
    "no final newline": PERSON.rstrip("\n"),
    "keywords in other cases": PERSON.replace("CHANNELS", "Channels").replace("rotation", "ROTATION"),
    "no colons": PERSON.replace("Frames:", "Frames").replace("Frame Time:", "Frame Time"),
    "channels before offset": re.sub(r"( *OFFSET.*\n)( *CHANNELS.*\n)", r"\2\1", PERSON),
}  # fmt: skip


@pytest.mark.parametrize("writing", WRITINGS)
def test_every_writing_is_the_same_clip(tmp_path, writing):
    assert WRITINGS[writing] != PERSON
    clip = motions.load(write(tmp_path, WRITINGS[writing]))
    assert_same_motion(clip, motions.load(write(tmp_path, PERSON, "plain.bvh")), 1e-15)


@pytest.mark.parametrize("coding", ["utf-16", "utf-8-sig"])
def test_what_an_editor_saved_as_unicode_is_the_same_clip(tmp_path, coding):
    (tmp_path / "saved.bvh").write_bytes(PERSON.encode(coding))
    assert_same_motion(motions.load(tmp_path / "saved.bvh"), motions.load(write(tmp_path, PERSON, "plain.bvh")), 1e-15)


def edited(number: int, line: str | None) -> str:
    """The person with one line (counted from 1) replaced, or left out."""
    return "\n".join(LINES[: number - 1] + ([] if line is None else [line]) + LINES[number:])


ROW = LINES[FIRST_ROW]
LAST = len(LINES) - 1  # lines of text; the file ends with a newline
MALFORMED = {
    "truncated hierarchy": ("\n".join(LINES[:20]), 20, "still open"),
    "cut in an OFFSET": ("\n".join([*LINES[:7], "    OFFSET 0"]), 8, "ends where a number was expected"),
    "truncated motion": ("\n".join(LINES[:-2]), LAST - 1, "declares 4 frames and holds 3 whole frames"),
    "cut in a row": ("\n".join([*LINES[:-2], "3 90.5"]), LAST, "3 whole frames and 2 values"),
    "no rows": ("\n".join(LINES[:FIRST_ROW]), FIRST_ROW, "holds none"),
    "no motion": (PERSON.split("MOTION")[0], FIRST_ROW - 3, "ends without MOTION"),
    "nothing after MOTION": (PERSON.split("Frames")[0], FIRST_ROW - 2, "expected 'Frames: N'"),
    "more frames than declared": (PERSON + 2 * (ROW + "\n"), LAST + 1, "declares 4 frames and holds 6"),
    "text after the frames": (PERSON + "the end\n", LAST + 1, "'the' is not a finite number"),
    "CHANNELS too many": (edited(5, LINES[4].replace("6", "5")), 5, "declares '5' channels and lists 6"),
    "CHANNELS too few": (edited(9, "CHANNELS 4 Zrotation Xrotation Yrotation"), 9, "declares '4' channels and lists 3"),
    "CHANNELS twice the same": (edited(9, "CHANNELS 2 Zrotation Zrotation"), 9, "lists a channel twice"),
    "CHANNELS unknown": (edited(9, "CHANNELS 3 Zrotation Wrotation Yrotation"), 9, "unknown channel 'Wrotation'"),
    "CHANNELS not a number": (edited(9, "CHANNELS three Zrotation"), 9, "declares 'three'"),
    "NaN": (edited(FIRST_ROW + 2, ROW.replace("90", "nan", 1)), FIRST_ROW + 2, "'nan' is not a finite number"),
    "infinity": (edited(FIRST_ROW + 2, ROW.replace("90", "-inf", 1)), FIRST_ROW + 2, "'-inf' is not a finite number"),
    "overflow": (edited(FIRST_ROW + 2, ROW.replace("90", "1e999", 1)), FIRST_ROW + 2, "'1e999' is too large"),
    "text for a number": (edited(FIRST_ROW + 2, ROW.replace("90", "9O", 1)), FIRST_ROW + 2, "'9O' is not a finite"),
    "two points": (edited(FIRST_ROW + 2, ROW.replace("90", "9.0.5", 1)), FIRST_ROW + 2, "'9.0.5' is not a finite"),
    "lost blank": (edited(FIRST_ROW + 2, ROW.replace("-10", "5-10", 1)), FIRST_ROW + 2, "a space is missing"),
    "decimal comma": (edited(FIRST_ROW + 2, ROW.replace("90", "90,5", 1)), FIRST_ROW + 2, "decimal comma"),
    "decimal comma in OFFSET": (edited(8, "OFFSET 0 45,0 0"), 8, "decimal comma"),
    "OFFSET of two": (edited(8, "OFFSET 0 45"), 9, "OFFSET needs three numbers; 'CHANNELS'"),
    "OFFSET of four": (edited(8, "OFFSET 0 45 0 1"), 8, "unexpected '1'"),
    "OFFSET NaN": (edited(8, "OFFSET 0 nan 0"), 8, "'nan' is not a finite number"),
    "no OFFSET": (edited(16, None), 16, "end site of line 14 closes without an OFFSET"),
    "two OFFSETs": (edited(9, "OFFSET 1 2 3"), 9, "second OFFSET"),
    "value lost": (edited(FIRST_ROW + 2, ROW.removeprefix("0 ")), FIRST_ROW + 2, "frame 1 has 20 values"),
    "value doubled": (edited(FIRST_ROW + 2, "0 " + ROW), FIRST_ROW + 2, "frame 1 has 22 values"),
    "value moved to the next row": (
        edited(FIRST_ROW + 2, ROW.removesuffix(" 1")).replace("\n2 91", "\n1 2 91"), FIRST_ROW + 2, "has 20 values"
    ),
    "Frame Time 0": (PERSON.replace("0.0333333", "0"), FIRST_ROW, "'0' is not a time above 0"),
    "Frame Time negative": (PERSON.replace("0.0333333", "-0.033"), FIRST_ROW, "'-0.033' is not a time above 0"),
    "Frame Time text": (PERSON.replace("0.0333333", "fast"), FIRST_ROW, "'fast' is not a finite number"),
    "Frame Time comma": (PERSON.replace("0.0333333", "0,0333"), FIRST_ROW, "decimal comma"),
    "Frame Time missing": (edited(FIRST_ROW, None), FIRST_ROW, "expected 'Frame Time"),
    "Frames 0": (PERSON.replace("Frames: 4", "Frames: 0"), FIRST_ROW - 1, "'0' is not a number of frames"),
    "Frames negative": (PERSON.replace("Frames: 4", "Frames: -4"), FIRST_ROW - 1, "'-4' is not a number of frames"),
    "Frames huge": (PERSON.replace("Frames: 4", "Frames: 999999999999"), LAST, "holds 4 whole frames"),
    "brace too many": (edited(FIRST_ROW - 3, "}\n}"), FIRST_ROW - 2, "after the last brace"),
    "brace too few": (edited(FIRST_ROW - 3, None), FIRST_ROW - 4, "still open"),
    "brace lost in the middle": (edited(17, None), FIRST_ROW - 4, "still open"),
    "opening brace lost": (edited(7, None), 7, "expected an opening brace after joint 'Chest'"),
    "joint without a name": (edited(6, "JOINT"), 6, "joint without a name"),
    "second root": (PERSON.replace("MOTION", "ROOT Other\n{\nOFFSET 0 0 0\n}\nMOTION"), FIRST_ROW - 2, "second root"),
    "no channels": (re.sub(r" *CHANNELS.*\n", "", PERSON), FIRST_ROW - 11, "no joint has a channel"),
    "joint in an end site": (edited(16, "JOINT Eye"), 16, "unexpected 'JOINT' in the end site of line 14"),
    "another format": ("# Wavefront OBJ\nv 0 0 0\n", 1, "not a BVH file: it begins with '#'"),
    "no ROOT": (edited(2, "JOINT Hips"), 2, "expected ROOT, found 'JOINT'"),
}  # fmt: skip


@pytest.mark.parametrize("case", MALFORMED)
def test_malformed_file_is_one_error_with_its_line(tmp_path, case):
    text, line, message = MALFORMED[case]
    path = write(tmp_path, text)
    with pytest.raises(FileError) as error:
        motions.load(path)
    assert message in str(error.value)
    assert str(error.value).startswith(f"{path}, line {line}: ")
    assert "\n" not in str(error.value)


def test_a_frame_more_than_declared_is_one(tmp_path):
    (tmp_path / "one_more.bvh").write_text(PERSON + ROW + "\n")
    clip = motions.load(tmp_path / "one_more.bvh", keep_first_frame=True)
    assert clip.frames == 5
    assert "frames: the file declares 4 and holds one more, which is taken for one, too" in clip.decisions


def test_what_is_no_text_file_is_one_error(tmp_path):
    with pytest.raises(FileError, match="is a directory"):
        motions.load(tmp_path)
    with pytest.raises(FileError, match=r"no file .*none\.bvh'$"):
        motions.load(tmp_path / "none.bvh")
    with pytest.raises(FileError, match="no file 'wlk'; shipped clips: "):
        motions.load("wlk")
    with pytest.raises(FileError, match="is empty"):
        motions.load(write(tmp_path, " \n"))
    with pytest.raises(FileError, match="binary"):
        motions.load(write(tmp_path, b"HIERARCHY\0\1\2"))
    with pytest.raises(FileError, match="not a regular file"):
        motions.load("/dev/zero")
    with pytest.raises(FileError):
        motions.load("nul\0byte.bvh")
    with pytest.raises(FileError, match="line 1: not a BVH file"):
        motions.load(write(tmp_path, bytes(range(1, 256)) * 9))


def test_a_folder_of_a_clips_name_does_not_hide_the_clip(tmp_path, monkeypatch):
    """As a run before may have left one; a file of that name is what is meant."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "walk").mkdir()
    assert motions.load("walk").name == "walk"
    with pytest.raises(FileError, match="is a directory"):
        motions.load("./walk")
    (tmp_path / "walk").rmdir()
    (tmp_path / "walk").write_text("no motion")
    with pytest.raises(FileError, match="line 1: not a BVH file"):
        motions.load("walk")


def scaled(text: str, factor: float) -> str:
    """The person in another unit: offsets and root positions times a factor."""

    def line(words: list[str]) -> str:
        if words[:1] == ["OFFSET"]:
            return " ".join(["OFFSET", *(f"{float(word) * factor:.9g}" for word in words[1:])])
        if len(words) == 21:
            return " ".join([*(f"{float(word) * factor:.9g}" for word in words[:3]), *words[3:]])
        return " ".join(words)

    return "\n".join(line(row.split()) for row in text.split("\n"))


@pytest.mark.parametrize(
    ("unit", "meters"), [("m", 1.0), ("cm", 0.01), ("mm", 0.001), ("inch", 0.0254), ("cmu", 0.0254 / 0.45)]
)
def test_unit_of_a_person_is_found(tmp_path, unit, meters):
    clip = motions.load(write(tmp_path, scaled(PERSON, 0.01 / meters)))
    np.testing.assert_allclose(clip.root_positions[0], [0, 0, 0.9], atol=1e-8)
    assert f"unit: {unit} = " in clip.decisions[-1]
    assert "outside" not in clip.decisions[-1]


def test_unit_and_height_by_hand(tmp_path):
    path = write(tmp_path, PERSON)
    by_name, by_number = motions.load(path, unit="inch"), motions.load(path, unit=0.0254)
    np.testing.assert_allclose(by_name.root_positions[0, 2], 90 * 0.0254)
    np.testing.assert_array_equal(by_name.offsets, by_number.offsets)
    np.testing.assert_array_equal(by_name.offsets, motions.load(path, unit="0.0254").offsets)
    assert "outside of 1.4 to 2.1 m" in by_name.decisions[-1]
    assert motions.load(path, height=1.85).standing_height() == pytest.approx(1.85, rel=1e-3)


def test_body_that_fits_no_unit_is_scaled_to_a_person(tmp_path):
    clip = motions.load(write(tmp_path, scaled(PERSON, 45 / 170)))
    assert clip.standing_height() == pytest.approx(1.7, rel=1e-3)
    assert "none that is known" in clip.decisions[-1]


@pytest.mark.parametrize(
    ("options", "error", "message"),
    [
        ({"unit": "furlong"}, UnknownNameError, "no unit named 'furlong'; available: m, cm, mm, inch, cmu"),
        ({"unit": 0.0}, ValueRangeError, "not 0"),
        ({"unit": float("nan")}, ValueRangeError, "not nan"),
        ({"up": "w"}, UnknownNameError, "no up axis named 'w'"),
        ({"height": -1.0}, ValueRangeError, "not -1"),
        ({"height": 1.7, "unit": "m"}, ValueRangeError, "not both"),
    ],
)
def test_options_that_make_no_sense(tmp_path, options, error, message):
    with pytest.raises(error, match=message):
        motions.load(write(tmp_path, PERSON), **options)


@pytest.mark.parametrize("names", ["known", "unknown"])
@pytest.mark.parametrize("up", ["y", "z"])
def test_up_axis_is_found_by_names_or_by_shape(tmp_path, up, names):
    clip = motions.load(write(tmp_path, PERSON_WITH_ARMS))
    if names == "unknown":
        clip = replace(clip, joints=tuple(f"node{i}" for i in range(len(clip.joints))))
    motions.save(clip, tmp_path / "turned.bvh", up=up)
    again = motions.load(tmp_path / "turned.bvh")
    assert_same_motion(again, clip)
    assert f"up: +{up.upper()} axis, along which the head is above the feet" in again.decisions[0]
    assert "wrong" not in again.decisions[0]


def rolled(clip: Clip, angles: np.ndarray, way: np.ndarray) -> Clip:
    """The clip's first pose, turned about the x axis by an angle [rad] in each frame, its root on a way (F, 3) [m]."""
    turns = quaternions.from_euler(np.asarray(angles)[:, None], "x")
    rotations = np.repeat(clip.rotations_wxyz[:1], len(angles), axis=0).copy()
    rotations[:, 0] = quaternions.multiply(turns, rotations[:, 0])
    return replace(clip, root_positions=way, rotations_wxyz=rotations, local_positions=None)


@pytest.mark.parametrize("up", ["y", "z"])
def test_a_handstand_hangs_a_crawl_crawls_and_a_flip_flips(tmp_path, up):
    """None of them is set on its feet by another choice of the axis, and where there is doubt it is told."""
    clip, frames = motions.load(write(tmp_path, PERSON_WITH_ARMS)), 30
    still, ahead = np.zeros((frames, 3)), np.linspace(0.0, 2.0, frames)
    floor = np.stack([0.0 * ahead, -ahead, 0.0 * ahead + 0.2], axis=1)
    for angles, way, doubt in (
        (np.full(frames, np.pi), still + np.array([0.0, 0.0, 1.0]), "though the feet are above the head"),
        (np.full(frames, np.pi / 2), floor, "a floor across it while it moves along its own length"),
        (np.linspace(0.0, 2.0 * np.pi, frames), still + np.array([0.0, 0.0, 1.5]), "far from upright"),
    ):
        made = rolled(clip, angles, way)
        motions.save(made, tmp_path / "rolled.bvh", up=up)
        again = motions.load(tmp_path / "rolled.bvh", unit="cm", keep_first_frame=True)
        assert_same_motion(again, made)
        told = next(decision for decision in again.decisions if decision.startswith("up:"))
        assert told.startswith(f"up: +{up.upper()} axis")
        assert doubt in told
        assert "if it's wrong" in told


@pytest.mark.parametrize("up", ["y", "z"])
def test_what_gets_far_along_its_own_length_off_a_floor_is_told_as_a_doubt(tmp_path, up):
    """It climbs, or it crawls over what is not even; a person on a trampoline does neither."""
    clip, frames = motions.load(write(tmp_path, PERSON_WITH_ARMS)), 30
    for climbed, doubt in ((2.0, True), (0.9, False)):
        sways = 0.3 * np.sin(np.arange(frames))
        made = rolled(clip, np.zeros(frames), np.stack([0.0 * sways, sways, np.linspace(0.0, climbed, frames)], axis=1))
        motions.save(made, tmp_path / "climbs.bvh", up=up)
        again = motions.load(tmp_path / "climbs.bvh", unit="cm", keep_first_frame=True)
        told = next(decision for decision in again.decisions if decision.startswith("up:"))
        assert told.startswith(f"up: +{up.upper()} axis")
        assert ("times its height along it, give up if it's wrong" in told) == doubt


@pytest.mark.parametrize("faster", [1.0, 3.0])
def test_a_pose_that_no_joint_is_turned_in_is_dropped_before_motion_as_fast(tmp_path, faster):
    """Arms that swing by some `faster` tenths of a turn from frame to frame, after a row of zeros, or after none."""
    clip, frames = motions.load(write(tmp_path, PERSON_WITH_ARMS)), 12
    swing = faster * np.pi / 3.0 * np.where(np.arange(frames) % 2, 1.0, 1.6)
    rotations = np.repeat(clip.rotations_wxyz[:1], frames, axis=0).copy()
    rotations[..., 0], rotations[..., 1:] = 1.0, 0.0
    arms = [clip.index(f"{side}Arm") for side in ("Left", "Right")]
    rotations[:, arms] = quaternions.from_euler(swing[:, None], "y")[:, None]
    root = np.repeat(clip.root_positions[:1], frames, axis=0)
    made = replace(clip, rotations_wxyz=rotations, root_positions=root, local_positions=None)
    motions.save(made, tmp_path / "swinging.bvh")
    whole = motions.load(tmp_path / "swinging.bvh")
    assert whole.frames == frames
    rotations[0, :, 0], rotations[0, :, 1:] = 1.0, 0.0
    motions.save(replace(made, rotations_wxyz=rotations), tmp_path / "bound.bvh")
    cut = motions.load(tmp_path / "bound.bvh")
    assert cut.frames == frames - 1
    assert any(decision.startswith("dropped frame 0") for decision in cut.decisions)


@pytest.mark.parametrize(
    ("written", "fps", "told"),
    [
        ("30", 30, "taken for 30 frames per second"), ("120.000", 120, "taken for 120 frames per second"),
        ("29.97", 30 / 1.001, "taken for 29.97 frames per second"),
        ("33.3333", 30, "taken for milliseconds, 30 frames per second"),
        ("8.33333", 120, "taken for milliseconds, 120 frames per second"),
        ("40", 25, "taken for milliseconds, 25 frames per second"),
    ],
)  # fmt: skip
def test_a_frame_time_that_is_a_rate_or_milliseconds_is_taken_for_it_and_told(tmp_path, written, fps, told):
    clip = motions.load(write(tmp_path, PERSON.replace("0.0333333", written)))
    assert clip.fps == pytest.approx(fps, rel=1e-9)
    assert told in clip.decisions[0]
    assert repr(written) in clip.decisions[0]


@pytest.mark.parametrize("written", ["20", "50", "0.5", "1000", "0.0001", "1e-5", "777"])
def test_a_frame_time_that_no_motion_has_is_refused_unless_the_rate_is_given(tmp_path, written):
    path = write(tmp_path, PERSON.replace("0.0333333", written))
    with pytest.raises(FileError, match=r"line \d+: Frame Time: .* no motion's, which has 5 to 1000 .*--rate"):
        motions.load(path)
    clip = motions.load(path, rate=24)
    assert clip.fps == 24.0
    assert not any("frame time" in decision for decision in clip.decisions)
    with pytest.raises(ValueRangeError, match="rate must be above 0"):
        motions.load(path, rate=0.0)


def test_a_pose_may_have_any_frame_time_and_a_number_any_exponent(tmp_path):
    header, row = PERSON.rstrip().splitlines()[:-4], PERSON.rstrip().splitlines()[-4]
    text = "\n".join([*header, row]).replace("Frames: 4", "Frames: 1").replace("0.0333333", "1.0")
    assert motions.load(write(tmp_path, text)).fps == 1.0
    long = "0." + "0" * 9 + "33e+" + "0" * 5000 + "8"
    assert motions.load(write(tmp_path, PERSON.replace("0.0333333", long))).fps == pytest.approx(1.0 / 0.033)


def test_no_control_character_of_a_name_stays_one(tmp_path):
    text = PERSON.replace("JOINT Chest", "JOINT \x1b[31mChest\x07")
    clip = motions.load(write(tmp_path, text))
    assert "\\x1b[31mChest\\x07" in clip.joints
    assert all(name.isprintable() for name in clip.joints)


ARM = """JOINT {side}Arm
    {{
      OFFSET {sign}18 10 0
      JOINT {side}ForeArm
      {{
        OFFSET {sign}28 0 0
        End Site
        {{
          OFFSET {sign}25 0 0
        }}
      }}
    }}
    JOINT Head"""
PERSON_WITH_ARMS = PERSON.replace("JOINT Head", ARM.format(side="Left", sign="")).replace(
    "JOINT Head", ARM.format(side="Right", sign="-")
)


def test_first_frame_that_jumps_is_dropped(tmp_path):
    pose = "0 90 0 0 0 0" + " 0" * 15
    with_pose = PERSON.replace(ROW, "60" + pose[1:] + "\n" + ROW).replace("Frames: 4", "Frames: 5")
    path = write(tmp_path, with_pose)
    clip = motions.load(path)
    assert_same_motion(clip, motions.load(write(tmp_path, PERSON, "plain.bvh")), 1e-15)
    assert clip.decisions[0].startswith("dropped frame 0: ")
    assert motions.load(path, keep_first_frame=True).frames == 5
    assert motions.load(write(tmp_path, PERSON), keep_first_frame=False).frames == 3


def test_clip_of_one_frame_loads(tmp_path):
    text = "\n".join(LINES[: FIRST_ROW + 1]).replace("Frames: 4", "Frames: 1")
    for keep in (None, True, False):
        assert motions.load(write(tmp_path, text), keep_first_frame=keep).frames == 1


def test_positions_replace_offsets(tmp_path):
    """A root's OFFSET and a six-channel joint's are void; a constant position becomes the offset."""
    text = PERSON.replace("OFFSET 0 0 0", "OFFSET 300 200 100", 1)
    clip = motions.load(write(tmp_path, text))
    assert_same_motion(clip, motions.load(write(tmp_path, PERSON, "plain.bvh")), 1e-15)

    six = PERSON.replace(
        "OFFSET 0 45 0\n    CHANNELS 3", "OFFSET 7 7 7\n    CHANNELS 6 Xposition Yposition Zposition", 1
    )
    rows = [line.split() for line in six.split("\n")[FIRST_ROW:-1]]

    def with_positions(heights: list[float]) -> Clip:
        motion = [" ".join([*row[:6], "0", str(y), "0", *row[6:]]) for row, y in zip(rows, heights, strict=True)]
        return motions.load(write(tmp_path, "\n".join([*six.split("\n")[:FIRST_ROW], *motion, ""])))

    still = with_positions([45, 45, 45, 45])
    assert_same_motion(still, clip, 1e-15)
    moving = with_positions([44, 45, 46, 45])
    assert moving.local_positions is not None
    np.testing.assert_allclose(moving.local_positions[:, 1], [[0, 0, y] for y in (0.44, 0.45, 0.46, 0.45)], atol=1e-15)
    np.testing.assert_array_equal(moving.local_positions[:, 0], moving.root_positions)
    np.testing.assert_array_equal(moving.local_positions[:, 2:], np.broadcast_to(moving.offsets[2:], (4, 7, 3)))


def test_root_without_position_channels_stands_at_its_offset(tmp_path):
    text = PERSON.replace("OFFSET 0 0 0", "OFFSET 300 200 100", 1).replace(
        "CHANNELS 6 Xposition Yposition Zposition", "CHANNELS 3"
    )
    rows = [" ".join(line.split()[3:]) for line in text.split("\n")[FIRST_ROW:]]
    clip = motions.load(write(tmp_path, "\n".join([*text.split("\n")[:FIRST_ROW], *rows])))
    np.testing.assert_allclose(clip.root_positions, np.broadcast_to([3, -1, 2], (4, 3)), atol=1e-15)
    assert not clip.offsets[0].any()


def test_names_with_prefix_blank_or_twin(tmp_path):
    text = PERSON.replace("JOINT Chest", "JOINT mixamorig:Spine").replace("JOINT LeftLeg", "JOINT Left Leg")
    text = text.replace("JOINT LeftFoot", "JOINT Foot").replace("JOINT RightFoot", "JOINT Foot")
    clip = motions.load(write(tmp_path, text))
    assert {"mixamorig:Spine", "Left Leg", "Foot", "Foot_2"} <= set(clip.joints)
    assert "renamed another joint 'Foot' to 'Foot_2'" in clip.decisions


def test_zero_length_offsets_and_a_body_of_no_size_load(tmp_path):
    text = re.sub(r"OFFSET .*", "OFFSET 0 0 0", PERSON)
    clip = motions.load(write(tmp_path, text))
    assert not clip.offsets.any()
    assert "no height" in " ".join(clip.decisions)


@pytest.mark.parametrize(
    ("written", "fps"),
    [
        (".0083333", 120), ("0.008333", 120), (".03333", 30), ("0.0333333", 30), ("0.033", 30), ("0.05", 20),
        ("0.008342", 120 / 1.001), ("0.04", 25), ("4.0e-2", 25), ("0.0333667", 30 / 1.001),
        ("0.0323", 1 / 0.0323), ("0.19", 1 / 0.19),
    ],
)  # fmt: skip
def test_rounded_frame_times_give_the_usual_rates(tmp_path, written, fps):
    clip = motions.load(write(tmp_path, PERSON.replace("0.0333333", written)))
    assert clip.fps == pytest.approx(fps, rel=1e-12)


def test_save_replaces_only_when_complete(tmp_path):
    clip = motions.load(write(tmp_path, PERSON))
    target = write(tmp_path, "before", "out.bvh")
    with pytest.raises(ValueRangeError, match="can't hold"):
        motions.save(replace(clip, joints=("a{b", *clip.joints[1:])), target)
    with pytest.raises(UnknownNameError, match="order of rotations"):
        motions.save(clip, target, order="xyx")
    assert target.read_text() == "before"
    motions.save(clip, target)
    assert_same_motion(motions.load(target), clip)
    (tmp_path / "folder").mkdir()
    for hopeless in (tmp_path / "folder", tmp_path / "none" / "out.bvh", "/proc/out.bvh"):
        with pytest.raises(FileError, match="can't write"):
            motions.save(clip, hopeless)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["clip.bvh", "folder", "out.bvh"]


def test_real_files_read_write_read(mocap, tmp_path):
    for path in sorted(mocap.glob("*.bvh")):
        clip = motions.load(path)
        motions.save(clip, tmp_path / "again.bvh", unit="m", up="z", order="xyz")
        again = motions.load(tmp_path / "again.bvh", unit="m", up="z", keep_first_frame=True)
        assert_same_motion(again, clip)


def test_real_files_are_decided_well(mocap):
    for path in sorted(mocap.glob("*.bvh")):
        clip = motions.load(path)
        decided = " ".join(clip.decisions)
        assert ("dropped frame 0" in decided) == path.name.startswith("cmu_"), path.name
        assert ("+Z axis" in decided) == ("zup" in path.name), path.name
        assert 1.4 < clip.standing_height() < 2.1, path.name
        feet = clip.world_positions()[
            :, [clip.index(motions.find_roles(clip.joints, clip.parents.tolist())["left_foot"])]
        ]
        assert -0.1 < feet[..., 2].min() < 0.2, path.name


def test_real_files_agree_with_pybvh(mocap):
    pybvh = pytest.importorskip("pybvh")
    for path in sorted(mocap.glob("*.bvh")):
        oracle = pybvh.read_bvh_file(path)
        up = "z" if "zup" in path.name else "y"
        clip = motions.load(path, unit="cm", up=up, keep_first_frame=True)
        names = [node.name for node in oracle.nodes if not node.is_end_site()]
        x, y, z = np.moveaxis(np.asarray(oracle.joint_positions()), -1, 0) * 0.01
        expected = np.stack([x, y, z] if up == "z" else [x, -z, y], axis=-1)
        order = [names.index(joint) for joint in clip.joints]
        np.testing.assert_allclose(clip.world_positions(), expected[:, order], atol=1e-9, err_msg=path.name)


@st.composite
def clips(draw) -> Clip:
    """Clips over random trees whose joints come depth first, as they do in files; some joints move."""
    count = draw(st.integers(1, 8))
    parents = [-1]
    path = [0]
    for joint in range(1, count):
        path = path[: draw(st.integers(1, len(path)))]
        parents.append(path[-1])
        path.append(joint)
    ends = sorted(draw(st.lists(st.integers(0, count - 1), max_size=4)))
    frames = draw(st.integers(1, 4))
    random = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    rotations = random.normal(size=(frames, count, 4))
    rotations[:, draw(st.integers(0, count - 1))] = quaternions.from_euler([0.3, np.pi / 2, 0.2], "zxy")
    offsets = random.normal(size=(count, 3))
    offsets[0] = 0
    root_positions = random.normal(size=(frames, 3)) * 10
    local = None
    if draw(st.booleans()) and count > 1 and frames > 1:
        local = np.repeat(offsets[None], frames, axis=0)
        moving = draw(st.lists(st.integers(1, count - 1), min_size=1, unique=True))
        local[:, moving] += random.normal(size=(frames, len(moving), 3))
        offsets[moving] = local[:, moving].mean(axis=0)
        local[:, 0] = root_positions
    return Clip(
        name="random",
        joints=tuple(f"joint{i}" for i in range(count)),
        parents=np.array(parents),
        offsets=offsets,
        end_parents=np.array(sorted(ends, key=lambda end: _end_rank(parents, end)), dtype=np.int64),
        end_offsets=random.normal(size=(len(ends), 3)),
        fps=draw(st.floats(5.0, 500)),
        root_positions=root_positions,
        rotations_wxyz=quaternions.make_continuous(quaternions.normalize(rotations)),
        local_positions=local,
    )


def _end_rank(parents: list[int], joint: int) -> int:
    """Last joint below a joint: the writer puts a joint's end sites after its child joints."""
    below = {joint}
    for other, parent in enumerate(parents):
        if parent in below:
            below.add(other)
    return max(below) * len(parents) - joint


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    clip=clips(),
    unit=st.sampled_from(["m", "cm", "mm", "inch", "cmu", 0.3]),
    up=st.sampled_from(["x", "y", "z", "-x", "-y", "-z"]),
    order=st.sampled_from(["".join(axes) for axes in permutations("xyz")]),
)
def test_write_then_read_is_the_identity(tmp_path, clip, unit, up, order):
    path = tmp_path / "clip.bvh"
    motions.save(clip, path, unit=unit, up=up, order=order)
    again = motions.load(path, unit=unit, up=up, keep_first_frame=True)
    assert_same_motion(again, clip, 2e-9)


WORDS = [
    "{",
    "}",
    "JOINT x",
    "End Site",
    "OFFSET",
    "CHANNELS",
    "3",
    "0",
    "-1e5",
    "1e999",
    "nan",
    "1,5",
    "MOTION",
    "\n",
    "é",
    "",
]


@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_damaged_files_load_or_are_file_errors(tmp_path, data):
    """Words and lines lost, doubled, replaced, swapped, and the end cut off."""
    parts = re.split(r"( +|\n)", PERSON_WITH_ARMS)
    for _ in range(data.draw(st.integers(1, 3))):
        at = data.draw(st.integers(0, len(parts) - 2))
        length = data.draw(st.sampled_from([1, 1, 2, 10, 40]))
        match data.draw(st.sampled_from(["lose", "double", "replace", "swap", "cut"])):
            case "lose":
                del parts[at : at + length]
            case "double":
                parts[at:at] = parts[at : at + length]
            case "replace":
                parts[at] = data.draw(st.sampled_from(WORDS) | st.text(max_size=3))
            case "swap":
                parts[at], parts[at + 1] = parts[at + 1], parts[at]
            case _:
                del parts[at + 1 :]
        parts = [*parts, "", ""]
    path = write(tmp_path, "".join(parts).encode(errors="surrogatepass"))
    error = None
    try:
        assert np.isfinite(motions.load(path).world_positions()).all()
    except FileError as caught:
        error = str(caught)
    assert error is None or "\n" not in error


@pytest.mark.parametrize(
    "text",
    [
        PERSON.replace("Frames: 4", "Frames: " + " " * 300_000 + "x"),
        PERSON.replace("OFFSET 0 45 0", "OFFSET 0 " + "4" * 300_000 + "x 0"),
        PERSON.replace(ROW, ROW + "7" * 300_000 + "e"),
        "HIERARCHY\nROOT a\n{ OFFSET 0 0 0 " + "JOINT a { OFFSET 0 1 0 " * 2000 + "}" * 2001,
        PERSON.replace("JOINT Head", "JOINT " + "Left" * 50_000),
    ],
    ids=["blanks", "offset", "row", "depth", "name"],
)
def test_no_text_takes_long(tmp_path, text):
    """Each is quadratic or exponential for a careless pattern: minutes, where the run of the tests allows seconds."""
    path = write(tmp_path, text)
    if "LeftLeft" in text:
        assert motions.load(path).frames == 4
    else:
        with pytest.raises(FileError):
            motions.load(path)


def test_shipped_clips_load_by_name_unless_a_file_has_it(tmp_path, monkeypatch):
    monkeypatch.setattr("motions.shipped._FOLDER", tmp_path)
    monkeypatch.chdir(tmp_path)
    write(tmp_path, PERSON, "stroll.bvh")
    assert motions.clip_names() == ("stroll",)
    assert motions.load("stroll").name == "stroll"
    with pytest.raises(UnknownNameError, match="no shipped clip named 'strol'; available: stroll"):
        motions.clip_path("strol")
    write(tmp_path, PERSON.replace("Frames: 4", "Frames: 5"), "stroll")
    with pytest.raises(FileError, match="declares 5 frames"):
        motions.load("stroll")
