"""Which tasks a batch has, what they are called, and which arguments of `cape replay` they are made of."""

import json
import subprocess
from dataclasses import replace
from pathlib import Path

import pytest

from cape.cli.batch import passing, plan, task
from cape.cli.batch.plan import Task
from cape.cli.batch.task import DONE, FAILED, LOG, STOPPED, complete, do, run_cape
from cape.version import VERSION
from motions.errors import FileError, UserError
from tests.support.command import Forks
from tests.support.processes import mistake_told

TASK = Task("walk", "walk", ("--spacing=0.1",), "", ".rrd", "", "1", inputs={"a": "b"})
FACTS = {"result": "finished", "frames": 3}


def test_names_tell_clips_of_one_name_apart():
    clips = ["a/walk.bvh", "b/walk.bvh", "b/Walk.bvh", "run", "x y/é ü!.bvh"]
    assert plan.names_of(clips, [{}]) == [["a_walk"], ["b_walk"], ["b_Walk_2"], ["run"], ["é-ü"]]
    swept = [{"fabric": "swim", "wind": "-3 0 0"}, {"fabric": "f/x", "wind": "1 0 0"}]
    assert plan.names_of(["run"], swept) == [["run_fabric=swim_wind=3-0-0", "run_fabric=x_wind=1-0-0"]]
    assert len({name for [name] in plan.names_of([f"{'lång' * 99}{k}" for k in range(9)], [{}])}) == 9


def test_a_folder_stands_for_the_motions_within_and_each_counts_once(tmp_path: Path):
    for name in ("b.bvh", "a.BVH", "in/c.bvh", "d.vrm", "notes.txt"):
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).touch()
    found = plan.clips_of(["walk", str(tmp_path), str(tmp_path / "in" / "c.bvh"), "walk"])
    assert found == ["walk", *(str(tmp_path / name) for name in ("a.BVH", "b.bvh", "d.vrm", "in/c.bvh"))]
    (tmp_path / "none").mkdir()
    with pytest.raises(FileError, match=r"no motion \(\.bvh, \.glb"):
        plan.clips_of([str(tmp_path / "none")])


def test_sweeps_combine_with_the_first_varying_slowest():
    assert passing.combinations([]) == [{}]
    found = passing.combinations(["fabric=swim, denim", "--spacing=0.1,0.2"])
    assert [(each["fabric"], each["spacing"]) for each in found] == [
        ("swim", "0.1"),
        ("swim", "0.2"),
        ("denim", "0.1"),
        ("denim", "0.2"),
    ]
    assert passing.swept_arguments({"fabric": "swim", "wind": "-3 0 0", "hold": "collar=neck"}) == (
        *("--fabric=swim", "--wind", "-3", "0", "0", "--hold=collar=neck"),
    )
    switched = {"shelter": "yes", "loop": "no", "strain-limit": "false", "self-contact": "true"}
    assert passing.swept_arguments(switched) == ("--shelter", "--no-strain-limit", "--self-contact")
    assert passing.swept_arguments({"self-contact": "off"}) == ("--no-self-contact",)
    with pytest.raises(UserError, match="takes true and false, not 'perhaps'"):
        passing.swept_arguments({"loop": "perhaps"})


BAD = {
    "a sweep of nothing": (["--sweep", "fabric="], "NAME=VALUE"),
    "a sweep of no option": (["--sweep", "colour=red"], "no option to sweep named 'colour'"),
    "a sweep of what is told otherwise": (["--sweep", "output=a,b"], "no option to sweep named 'output'"),
    "a sweep twice": (["--sweep", "seed=1", "--sweep", "seed=2"], "given twice"),
    "a value besides a sweep": (["--seed", "1", "--sweep", "seed=2"], "leave one of them out"),
    "an unknown fabric in a sweep": (["--sweep", "fabric=cape,silk"], "no fabric named 'silk'"),
    "no number in a sweep": (["--sweep", "spacing=0.1,x"], "'--spacing'"),
    "an unknown unit in a sweep": (["--sweep", "unit=cm,zz"], "no unit named 'zz'"),
    "a misspelt clip": (
        ["wlak"],
        "no file 'wlak'; shipped clips: idle, jump, kick, run, spin, walk; did you mean 'walk'?",
    ),
    "a file that is not there": (["a.bvh"], "no file 'a.bvh'"),
    "an unknown axis": (["--up", "q"], "'q'"),
    "no rate": (["--fps", "0"], "fps must be above 0"),
    "no height": (["--height", "0"], "height must be more than 0 m"),
    "an end before the beginning": (["--start", "2", "--end", "1"], "can't take a motion from 2 s to 1 s"),
    "an unknown role": (["--attach", "tail=hips"], "no role named 'tail'"),
    "an unknown robot": (["--skeleton", "g9"], "no robot named 'g9'"),
    "hitboxes of an unknown kind": (["--hitboxes", "round"], "no way to make hitboxes named 'round'"),
    "hitboxes that are not there": (["--hitboxes", "a.toml"], "a.toml"),
    "an unknown layer": (["--layers", "cap"], "'cap'"),
    "an unknown tab": (["--tab", "capes"], "no tab named 'capes'"),
    "too large a sweep": (["--sweep", "seed=" + ",".join(map(str, range(100_001)))], "100001 combinations"),
    "an unknown format": (["--format", "fbx"], "available: rrd, npz, usd"),
    "layers of an export": (["--format", "npz", "--layers", "cape"], "is for recordings"),
    "no jobs": (["--jobs", "0"], "--jobs"),
    "an address of no known kind": (["--cluster", "http://a:1"], "tcp://HOST:PORT"),
    "an encrypted cluster without certificates": (["--cluster", "tls://a:1"], "--tls-ca, --tls-cert, --tls-key"),
    "certificates of a plain cluster": (["--cluster", "tcp://a:1", "--tls-ca", "a.pem"], "not encrypted"),
}


@pytest.mark.parametrize("case", BAD)
def test_mistakes_are_told_before_anything_is_begun(case: str, forks: Forks, tmp_path: Path):
    arguments, told = BAD[case]
    _, line = mistake_told(forks("batch", "walk", "-o", "out", *arguments, folder=tmp_path))
    assert told in line
    assert len(line) < 600
    assert list(tmp_path.iterdir()) == []


def test_a_scene_s_files_count_as_inputs(tmp_path: Path):
    (tmp_path / "wind.csv").write_text("0,1,0,0\n1,1,0,0\n")
    (tmp_path / "hero.toml").write_text('fabric = "velvet"\nwind-file = "wind.csv"\n[fabrics.velvet]\nbase = "denim"\n')
    found = passing.files_named([f"--scene={tmp_path / 'hero.toml'}"])
    assert {Path(name).name for name in found} == {"hero.toml", "wind.csv"}


def answering(*statuses: int | None):
    """A stand-in for the process of a run, which writes its output where it ends well; and how often it was called."""
    calls = []

    def run(arguments, *, place, said, stopped):
        status = statuses[len(calls)]
        calls.append(arguments)
        said.write_text("cape: it is Monday\n" if status == 2 else "")
        if status == 0:
            Path(arguments[arguments.index("-o") + 1]).write_bytes(b"recording")
        return status, json.dumps(FACTS)

    return run, calls


@pytest.mark.parametrize(
    ("statuses", "status", "error"),
    [
        ((-9, -11, 0), DONE, ""),
        ((-9, -9, -9), FAILED, "its process was killed 3 times, by signal 9"),
        ((2,), FAILED, "it is Monday"),
        ((-9, None), STOPPED, "stopped before it was done"),
    ],
)
def test_a_task_is_tried_again_where_its_process_is_killed(statuses, status, error, tmp_path, monkeypatch):
    run, calls = answering(*statuses)
    monkeypatch.setattr(task, "run_cape", run)
    found = do(replace(TASK, folder=str(tmp_path)), lambda: False)
    assert (found.status, found.error, found.attempts, len(calls)) == (status, error, len(statuses), len(statuses))


def test_what_stands_is_of_the_same_options_inputs_and_version_and_all_there(tmp_path: Path, monkeypatch):
    monkeypatch.setattr(task, "run_cape", answering(0)[0])
    own = replace(TASK, folder=str(tmp_path))
    assert complete(own) is None
    done = do(own, lambda: False)
    assert complete(own) == replace(done, attempts=0)
    assert done.facts == FACTS
    for other in (
        replace(own, arguments=()),
        replace(own, inputs={"a": "c"}),
        replace(own, version="2"),
        replace(own, suffix=".npz"),
        replace(own, clip="run"),
    ):
        assert complete(other) is None
    own.output.write_bytes(b"torn")
    assert complete(own) is None


def test_a_task_that_can_write_nothing_fails_in_a_line(tmp_path: Path):
    (tmp_path / "walk").write_text("no folder")
    found = do(replace(TASK, folder=str(tmp_path)), lambda: False)
    assert (found.status, found.attempts) == (FAILED, 1)
    assert "File exists" in found.error


def test_the_end_of_a_run_is_not_looked_for_but_waited_for(tmp_path: Path, monkeypatch):
    """Python waits with a time limit by looking ever so often, up to 50 ms late."""
    limits, wait = [], subprocess.Popen.wait

    def noted(process, timeout=None):
        limits.append(timeout)
        return wait(process, timeout)

    monkeypatch.setattr(subprocess.Popen, "wait", noted)
    status, printed = run_cape(["--version"], place=tmp_path, said=tmp_path / LOG, stopped=lambda: False)
    assert (status, printed) == (0, f"cape {VERSION}\n")
    assert limits == [None]


def test_a_run_is_ended_while_it_is_at_work(tmp_path: Path):
    asked = []
    status, _ = run_cape(
        ["replay", "walk", "-o", "a.rrd"], place=tmp_path, said=tmp_path / LOG,
        stopped=lambda: len(asked) > 1 or asked.append(None) is not None,
    )  # fmt: skip
    assert status is None
    assert len(asked) == 2
    assert not (tmp_path / "a.rrd").exists()


def test_a_run_that_nobody_waits_for_is_ended(tmp_path: Path):
    assert run_cape(["replay"], place=tmp_path, said=tmp_path / LOG, stopped=lambda: True) == (None, "")
