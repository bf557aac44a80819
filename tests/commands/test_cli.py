"""The installed command, as a user calls it."""

import json
import re
import signal
import subprocess
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import motions
from cape import FABRICS, GARMENTS
from tests.support.command import CAPE, Done, Forks, cape
from tests.support.processes import mistake_told


def entities_of(recording: Path) -> set[str]:
    import rerun as rr

    return {chunk.entity_path for chunk in rr.chunk.RrdReader(recording).stream()}


def one_frame(path: Path) -> None:
    clip = motions.load("walk")
    motions.save(clip.trim(0.0, 0.0), path)


@pytest.fixture(scope="module")
def broken(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("broken")
    walk = motions.clip_path("walk").read_text()
    (folder / "empty.bvh").write_text("")
    (folder / "truncated.bvh").write_text(walk[:2000])
    (folder / "words.bvh").write_text("hello\nworld\n")
    (folder / "binary.bvh").write_bytes(bytes(range(256)) * 40)
    one_frame(folder / "still.bvh")
    (folder / "kept.rrd").write_text("kept")
    (folder / "scene.toml").write_text('clip = "walk"')
    np.savez(folder / "kept.npz", take=np.zeros(1))
    return folder


BAD = {
    "a missing file": (["replay", "missing.bvh"], "missing.bvh"),
    "a directory": (["replay", "."], "directory"),
    "an empty file": (["replay", "empty.bvh"], "empty"),
    "a truncated file": (["replay", "truncated.bvh"], "line"),
    "another kind of file": (["replay", "words.bvh"], "not a BVH file"),
    "binary data": (["replay", "binary.bvh"], "binary"),
    "a scene file": (["replay", "scene.toml"], "--scene"),
    "a recording": (["info", "kept.rrd"], "cape render"),
    "a kept take": (["replay", "kept.npz"], "cape export"),
    "a single frame": (["replay", "still.bvh"], "single frame"),
    "an unknown fabric": (["replay", "--fabric", "steel"], "denim"),
    "an unknown garment": (["replay", "--garment", "toga"], "shoulder_cape"),
    "a garment that takes no length": (["replay", "--garment", "sash", "--length", "1"], "takes no length"),
    "a garment that is too short": (["replay", "--garment", "cloak", "--length", "0.1"], "shoulders"),
    "an unknown solver": (["replay", "--solver", "magic"], "xpbd"),
    "an unknown layer": (["replay", "--layers", "cape,hat"], "hitboxes"),
    "an unknown bone": (["replay", "--attach", "chest=Tail"], "Spine2"),
    "an unknown role": (["replay", "--attach", "tail=Hips"], "left_shoulder"),
    "an attachment without a bone": (["replay", "--attach", "chest"], "ROLE=BONE"),
    "a part that no bone is to hold": (["replay", "--hold", "collar"], "EDGE=BONE"),
    "a part that the garment lacks": (["replay", "--hold", "tail=chest"], "collar"),
    "an unknown unit": (["replay", "--unit", "parsec"], "inch"),
    "a negative length": (["replay", "--length", "-1"], "length"),
    "a spacing that is too wide": (["replay", "--spacing", "0.6"], "spacing"),
    "a spacing that is too fine": (["replay", "--spacing", "0.0001"], "spacing"),
    "no number": (["replay", "--spacing", "wide"], "--spacing"),
    "a wind of two numbers": (["replay", "--wind", "1", "2"], "--wind"),
    "a wind that is not finite": (["replay", "--wind", "nan", "0", "0"], "wind"),
    "gusts of no wind": (["replay", "--gusts", "0.3"], "gusts"),
    "turbulence below zero": (["replay", "--turbulence", "-1"], "turbulence"),
    "a record of the wind that is none": (["replay", "--wind-file", "words.bvh"], "line 1"),
    "an unknown way to treat cuts": (["replay", "--cuts", "tear"], "carry"),
    "no substeps": (["replay", "--substeps", "0"], "substeps"),
    "no tolerance": (["replay", "--tolerance", "0"], "tolerance"),
    "a tolerance and a budget": (["replay", "--tolerance", "1", "--budget", "4"], "or a budget"),
    "a tolerance and a solver": (["replay", "--tolerance", "1", "--solver", "xpbd"], "chooses the solver"),
    "a budget and substeps": (["replay", "--budget", "4", "--substeps", "8"], "leave"),
    "no frame rate": (["replay", "--fps", "0"], "fps"),
    "a start after the end": (["replay", "--start", "3", "--end", "2"], "3 s"),
    "an unknown option": (["replay", "--nope"], "(cape replay --help"),
    "an unknown command": (["dance"], "dance"),
    "a folder that is not there": (["replay", "-o", "nowhere/walk.rrd"], "nowhere"),
    "an output that is a folder": (["replay", "-o", "."], "directory"),
    "an output that no program would open": (["replay", "-o", "walk.fbx"], "named '.fbx'; available: .rrd, .npz"),
    "a film of a replay": (["replay", "-o", "walk.gif"], "cape render"),
    "an output that is a motion": (["replay", "-o", "words.bvh"], "named '.bvh'"),
    "a live run to another kind of file": (
        ["live", "--no-viewer", "--seconds", "0.5", "-o", "walk.fbx"],
        "named '.fbx'",
    ),
    "hitboxes to another kind of file": (["hitboxes", "walk", "-o", "walk.usd"], "available: .rrd"),
    "hitboxes written as no TOML": (["hitboxes", "walk", "--write", "walk.txt"], "available: .toml"),
    "a clip's name misspelt": (["replay", "wlk"], "did you mean 'walk'?"),
    "hitboxes of nothing": (["hitboxes", "missing.bvh"], "missing.bvh"),
    "information on nothing": (["info", "missing"], "walk"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_users_mistake_is_one_line_and_status_2(case, broken, forks):
    arguments, word = BAD[case]
    if arguments[0] == "replay" and "-o" not in arguments:
        arguments = [*arguments, "-o", "kept.rrd"]
    before = sorted(p.name for p in broken.iterdir())
    done = forks(*arguments, folder=broken)
    said, line = mistake_told(done)
    assert word in line
    assert not any("Traceback" in text for text in said)
    assert (broken / "kept.rrd").read_text() == "kept"
    assert sorted(p.name for p in broken.iterdir()) == before


KEYS = [
    "frames", "fps", "vertices", "bones", "capsules", "solver", "substeps", "compile_s", "solve_s", "realtime_factor",
    "stretch_max", "stretch_p99", "shoulders_covered", "collar_gap_mm", "collar_gap_p95_mm", "folds", "hem_m",
    "penetration_max_mm", "self_contact_mm", "left_out", "jumps", "put_on_anew", "result", "warnings",
    "output", "layers_crossed",
]  # fmt: skip


class Once:
    """Runs a command once, however many tests look at what it printed."""

    def __init__(self, forks: Forks, folder: Path):
        """All run in one folder."""
        self._forks, self._folder = forks, folder
        self._done: dict[tuple[str, ...], Done] = {}

    def __call__(self, *arguments: str) -> Done:
        if arguments not in self._done:
            self._done[arguments] = self._forks(*arguments, folder=self._folder)
        return self._done[arguments]

    def facts(self, *arguments: str) -> dict[str, Any]:
        """The facts that a command prints in JSON."""
        done = self(*arguments, "--json")
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)


@pytest.fixture(scope="module")
def once(forks, tmp_path_factory) -> Once:
    return Once(forks, tmp_path_factory.mktemp("once"))


@pytest.fixture(scope="module")
def plain(tmp_path_factory) -> tuple[dict[str, Any], Path]:
    """Facts of a replay without a clip, and the folder of its recording."""
    folder = tmp_path_factory.mktemp("plain")
    done = cape("replay", "--json", "--end", "0.5", folder=folder)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), folder


BRIEF = ("replay", "walk", "--end", "0.1", "-o", "out.npz")
COARSE = ("replay", "walk", "--end", "0.3", "-o", "out.npz", "--garment", "back_cape", "--spacing", "0.06")
DENIM = (*COARSE, "--end", "0.2", "--fabric", "denim")
# All that adds to the table, on the clip whose feet the cape doesn't reach.
MUCH = ("replay", "idle", "--end", "0.1", "-o", "out.rrd", "--garment", "back_cape", "--spacing", "0.06",
        "--self-contact", "--check", "--solver", "xpbd", "--substeps", "12")  # fmt: skip


def test_replay_without_a_clip_replays_the_walk_and_tells_it_in_json(plain):
    facts, folder = plain
    assert set(KEYS) <= set(facts)
    assert facts["output"] == "walk.rrd"
    assert (folder / "walk.rrd").stat().st_size > 100_000
    assert facts["frames"] == 31
    assert facts["fps"] == pytest.approx(60.0)
    assert facts["result"] == "finished"
    assert [p.name for p in folder.iterdir()] == ["walk.rrd"]


def test_replay_prints_a_table(once):
    done = once(*MUCH)
    assert done.returncode == 0
    for word in ("xpbd, 12 substeps", "largest stretch", "deepest penetration", "real time", "out.rrd"):
        assert word in done.stdout
    assert "unit: cm" in done.stderr


def test_self_contact_is_told_in_the_summary(once):
    done = once(*MUCH)
    assert done.returncode == 0, done.stderr
    assert "layers of the cape stay 5.0 mm apart" in done.stdout


def test_no_thread_stretches_further_than_its_fabric_allows_unless_asked(once):
    spin = ("replay", "spin", "--start", "0.8", "--end", "1.3", "-o", "out.npz", "--spacing", "0.05")
    limited, free = (once.facts(*spin, *more)["stretch_max"] for more in ((), ("--no-strain-limit",)))
    assert limited < 0.06 < 0.1 < free


def test_options_reach_the_simulation(once, plain):
    usual, _ = plain
    coarse = once.facts(*BRIEF, "--spacing", "0.05", "--fabric", "denim")
    # Vertices 5 cm apart instead of 0.0252 of 1.75 m, rows and columns each to the nearest.
    assert coarse["vertices"] == pytest.approx(usual["vertices"] * (0.0252 * 1.75 / 0.05) ** 2, rel=0.05)
    assert coarse["substeps"] < usual["substeps"]
    short = once.facts(*BRIEF, "--length", "0.5", "--fps", "30")
    assert short["vertices"] < 0.6 * usual["vertices"]
    assert short["fps"] == pytest.approx(30.0)
    assert short["frames"] == 4


BEYOND = re.compile(r"at least \d+\.\d\d m beyond the cloth's reach of \d\.\d\d m")


def unfolded(text: str) -> str:
    """A table's text without the terminal's line breaks."""
    return " ".join(text.split())


def test_hitboxes_tell_of_each_collider_what_the_cape_does_to_it(tmp_path, forks):
    done = forks("hitboxes", "idle", "--end", "0.1", folder=tmp_path)
    assert done.returncode == 0
    told = unfolded(done.stdout)
    assert re.search(
        r"left_chest capsule of 122 mm on Spine1, thickness 5 mm; kept: within .* touched in 7 frames", told
    )
    assert re.search(
        rf"left_foot capsule of 38 mm on LeftFoot, thickness 5 mm; left out: {BEYOND.pattern}; never", told
    )
    assert re.search(rf"floor plane that stands still, thickness 5 mm; left out: {BEYOND.pattern}; never", told)
    assert [p.name for p in tmp_path.iterdir()] == ["idle_hitboxes.rrd"]
    entities = entities_of(tmp_path / "idle_hitboxes.rrd")
    assert {"/world/cape", "/world/hitboxes", "/world/shells", "/world/contacts/points"} <= entities


def test_bare_hitboxes_need_no_simulation(tmp_path):
    """Nothing compiled is called: the compiler is off, with which simulating would take minutes."""
    done = cape("hitboxes", "kick", "--bare", folder=tmp_path, NUMBA_DISABLE_JIT="1")
    assert done.returncode == 0
    told = unfolded(done.stdout)
    assert "left_forearm capsule of 37 mm on LeftForeArm, thickness 5 mm; kept: within" in told
    assert re.search(rf"floor plane that stands still, thickness 5 mm; left out: {BEYOND.pattern}", told)
    assert [p.name for p in tmp_path.iterdir()] == ["kick_hitboxes.rrd"]
    entities = entities_of(tmp_path / "kick_hitboxes.rrd")
    assert {"/world/hitboxes", "/world/shells", "/world/colliders/floor"} <= entities
    assert not {"/world/cape", "/world/contacts/points"} & entities


def test_a_check_measures_apart_from_the_solver(once, plain):
    facts = once.facts(*COARSE, "--check")
    assert set(facts["check"]) == {"vertices", "faces"}
    assert 0.0 <= facts["check"]["vertices"]["depth_mm"] <= facts["check"]["faces"]["depth_mm"] < 5.0
    # The recording's positions are rounded to single precision.
    assert facts["check"]["vertices"]["depth_mm"] == pytest.approx(facts["penetration_max_mm"], abs=2e-3)
    assert "check" not in plain[0]
    assert re.search(r"check of faces +\d+\.\d mm", once(*MUCH).stdout)


def test_a_check_measures_the_error_of_the_time_step(once):
    # A quarter of the step: with half of it, the moment in which a vertex touches may make more than the step does.
    errors = [once.facts(*COARSE, "--check", *more)["step_error"] for more in ([], ["--substeps", "160"])]
    assert all(error["seconds"] == 0.1 and error["parts"] == 10 for error in errors)
    assert 0.0 < errors[1]["rms_mm"] < errors[0]["rms_mm"] < errors[0]["max_mm"] < 10.0


def test_a_tolerance_or_a_budget_chooses_solver_and_steps(once):
    plain = once.facts(*DENIM)
    assert plain["step_error"] is None
    chosen = once.facts(*DENIM, "--tolerance", "5")
    assert chosen["solver"] in ("euler", "xpbd")
    assert chosen["step_error"]["parts"] >= 1
    fine = once.facts(*DENIM, "--budget", "10000")
    assert fine["solver"] == "euler"
    assert fine["substeps"] == pytest.approx(8 * plain["substeps"], abs=8)
    assert "mm gathered in 0.1 s" in unfolded(once(*DENIM, "--solver", "auto").stdout)


def test_replay_says_what_it_left_out_and_why(once):
    left_out = once.facts(*MUCH)["left_out"]
    assert set(left_out) == {"left_foot", "right_foot", "floor"}
    assert all(BEYOND.fullmatch(reason) for reason in left_out.values())
    assert f"left out floor: {left_out['floor']}" in unfolded(once(*MUCH).stdout)
    assert re.search(rf"beyond reach floor: {BEYOND.pattern}", unfolded(once("info", "idle").stdout))


def test_clips_and_info_tell_what_there_is(once):
    told = once("clips").stdout
    assert all(name in told for name in motions.clip_names())
    told = once("info", "idle").stdout
    for word in ("60 fps", "left_shoulder: LeftShoulder", "unit: cm", "1.75 m", "no jump"):
        assert word in told


def test_what_is_read_is_not_written(once, tmp_path):
    clip = tmp_path / "walk.bvh"
    motions.save(motions.load("walk").trim(0.0, 0.2), clip)
    before = clip.read_bytes()
    (tmp_path / "link.bvh").symlink_to(clip)
    for output in (clip, tmp_path / "link.bvh"):
        _, line = mistake_told(once("hitboxes", clip, "--bare", "-o", output))
        assert line.endswith("it is what is read")
    _, line = mistake_told(once("hitboxes", clip, "--bare", "-o", "-"))
    assert "standard output" in line
    assert clip.read_bytes() == before


def test_an_end_beyond_the_clip_is_told_and_taken_for_its_end(once):
    last = motions.load("idle").duration
    done = once(
        "replay", "idle", "--start", str(last - 0.1), "--end", "99", "-o", "out.rrd", "--spacing", "0.06", "--json"
    )
    assert json.loads(done.stdout)["frames"] == 7
    assert f"end: 99 s is beyond the motion, which lasts {last:g} s: it is taken to its end" in unfolded(done.stderr)


def test_fabrics_are_listed_with_how_they_drape_and_who_measured_them(once):
    told = unfolded(once("fabrics").stdout)
    assert all(name in told for name in FABRICS)
    assert (
        "denim denim of 11 oz: falls in some five folds, bending length 1.7 / 2.0 cm; 324 g/m2, "
        "stretch 2034 / 412 N/m, shear 53.4 N/m, bend 15.5 / 26.5 µN m; Wang, O'Brien and Ramamoorthi 2011" in told
    )
    assert "stretch, shear not measured" in told
    facts = once.facts("fabrics")
    assert set(facts) == set(FABRICS)
    assert facts["cape"]["measured"] is None
    denim = facts["denim"]
    assert denim["stretch_N_m"] == [FABRICS["denim"].stretch_warp, FABRICS["denim"].stretch_weft]
    assert denim["bend_N_m"] == [FABRICS["denim"].bend_warp, FABRICS["denim"].bend_weft]
    assert "Data-Driven Elastic Models for Cloth" in denim["measured"]["source"]
    assert denim["measured"]["figures"]["density"] == "0.324 kg/m2"


def test_garments_are_listed_and_worn(once):
    told = unfolded(once("garments").stdout)
    assert all(f"{garment.name} {garment.title}" in told for garment in GARMENTS.values())
    assert once.facts("garments") == {garment.name: garment.title for garment in GARMENTS.values()}
    command = (*BRIEF, "--spacing", "0.06", "--garment")
    assert once.facts(*command, "tabard")["result"] == "finished"


@pytest.mark.few("leather-weight")
@pytest.mark.parametrize("name", ["chiffon-weight", "jersey", "leather-weight"])
def test_a_cape_may_be_of_any_fabric(once, name):
    worn = ("--garment", "back_cape", "--spacing", "0.06", "--fabric", name)
    facts = once.facts(*BRIEF, *worn)
    assert facts["result"] == "finished"


def test_an_interrupted_run_leaves_a_whole_recording_or_none(tmp_path):
    process = subprocess.Popen(
        # Put on at once, and moving for long: few vertices, many frames.
        [CAPE, "replay", "walk", "--spacing", "0.05", "--fps", "1000", "--substeps", "300", "-o", "part.rrd", "--json"],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stderr is not None
    process.stderr.readline()
    # Long before the end; where it is still compiling there is nothing to keep.
    time.sleep(2.0)
    process.send_signal(signal.SIGINT)
    out, _ = process.communicate(timeout=120)
    assert process.returncode == 130
    if out:
        facts = json.loads(out)
        assert facts["result"] == f"stopped at frame {facts['frames']}"
    assert [p.name for p in tmp_path.iterdir()] == (["part.rrd"] if out else [])
