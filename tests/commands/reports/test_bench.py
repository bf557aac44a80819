"""The benchmark command: what it reports, not how fast this machine is."""

import json
import struct
import subprocess
import sys
from types import SimpleNamespace

import pytest

from cape.bench import Plan, run, timing
from cape.bench.machine import caches
from cape.bench.plot import save_plot
from cape.bench.rows import Row
from cape.bench.run import LINEAR, linear_to
from cape.bench.sections import features
from cape.bench.sections.capes import gains
from cape.bench.sheets import WHOLE, assemble_standing, sheet, variants
from cape.bench.subject import Subject
from cape.solvers import SymplecticEuler
from motions.errors import UserError

TINY = Plan(
    solvers=("euler",),
    repeats=2,
    least=1e-4,
    all_precisions=False,
    table=(80,),
    vertices=(80, 160),
    mesh_vertices=(80,),
    other_vertices=(80,),
    thread_vertices=(160,),
    capes=(1, 2),
    cape_vertices=80,
    seconds=0.1,
)
FEW = ("springs", "damping")  # variants that are timed here; each is compiled for itself
ROW = {
    "section": str, "solver": str, "layout": str, "precision": str, "features": list, "vertices": int, "threads": int,
    "capes": int, "substeps": int | None, "ns_per_vertex_substep": float, "ratio_to_scalar": float | None,
    "ratio_to_limit": float | None, "compile_s": float,
}  # fmt: skip


@pytest.fixture(scope="module")
def report():
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(features, "variants", lambda n: [v for v in variants(n) if v.label in FEW])
        return run(TINY)


def row(**fields) -> Row:
    plain = {"section": "vertices", "solver": "euler", "layout": "grid", "precision": "single", "compile_s": 0.0}
    return Row(**(plain | {"vertices": 1500, "ns_per_vertex_substep": 1.0} | fields))


def test_the_command_prints_one_json_object(tmp_path):
    script = f"""
import sys
from cape.bench.sections import features
from cape.bench.plan import Plan
from cape.cli import main
from cape.cli.commands import bench
real = features.variants
features.variants = lambda n: [v for v in real(n) if v.label in {FEW}]
bench.QUICK = {TINY!r}
sys.argv = ["cape", "bench", "--quick", "--json", "-o", {str(tmp_path)!r}]
main()
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    facts = json.loads(done.stdout)
    assert set(facts) == {"machine", "versions", "plain", "linear_to_vertices", "capes_gain", "features", "rows"}
    assert {"python", "cape", "numpy", "numba"} <= set(facts["versions"])
    assert facts["machine"]["cores"] >= 1
    for found in facts["rows"]:
        assert set(found) == set(ROW)
        for key, kind in ROW.items():
            assert isinstance(found[key], kind), key
        assert found["ns_per_vertex_substep"] > 0.0
    assert json.loads((tmp_path / "bench.json").read_text()) == facts


def test_every_section_has_its_rows(report):
    cases = {(r.section, r.solver, r.layout, r.precision) for r in report.rows}
    for layout in ("grid", "mesh"):
        for precision in ("single", "double"):
            assert {("solvers", s, layout, precision) for s in ("euler", "scalar", "limit")} <= cases
    assert {r.capes for r in report.section("capes")} == set(TINY.capes)
    assert {r.vertices for r in report.section("vertices")} == {sheet(n).scene.cloth.vertices for n in TINY.vertices}
    assert 1 in {r.threads for r in report.section("threads")}
    assert [f.label for f in report.features] == list(FEW)
    assert [p.solver for p in report.plain] == ["euler"]


def test_ratios_are_those_of_the_costs(report):
    rows = report.section("solvers")
    cost = {(r.solver, r.layout, r.precision): r.ns_per_vertex_substep for r in rows}
    for r in rows:
        like = (r.layout, r.precision)
        assert r.ratio_to_scalar == pytest.approx(cost["scalar", *like] / r.ns_per_vertex_substep)
        assert r.ratio_to_limit == pytest.approx(r.ns_per_vertex_substep / cost["limit", *like])


def test_a_feature_adds_what_it_costs_beyond_the_scene_without_it(report):
    first, second = report.features
    assert first.added_ns is None
    assert second.added_ns == pytest.approx(second.ns_per_vertex_substep - first.ns_per_vertex_substep)


def test_the_plain_scene_is_measured_as_it_moves(report):
    plain = report.plain[0]
    assert plain.result == "finished"
    assert (plain.vertices, plain.frames) == (1536, round(60 * TINY.seconds))
    # A cape that falls freely into its hanging shape is stretched, by less than a tenth.
    assert 1e-4 < plain.stretch_max < 0.1


def test_all_features_of_a_scene_are_among_the_variants():
    labels = " ".join(v.label for v in variants(80))
    for word in ("damping", "bending", "wind", "capsules", "friction", "box", "plane", "statistics", "off"):
        assert word in labels


def test_a_feature_has_code_of_its_own_and_its_absence_has_not():
    found = {}
    for variant in variants(80):
        subject = Subject(assemble_standing(variant.scene), sheet(80).track, SymplecticEuler(precision="single"))
        found[variant.label] = subject.code
    same = {v.label for v in variants(80) if v.over is not None and found[v.label] == found[v.over]}
    # Friction is a number that is asked for where a vertex touches, too seldom to be worth another compilation.
    assert same == {"friction", "statistics", "all of these switched off"}
    assert found["capsules out of reach"] == found["capsules touched"] != found[WHOLE]


def test_turns_keep_the_least_time_and_count_compiling_apart(monkeypatch):
    clock = SimpleNamespace(now=0.0)
    monkeypatch.setattr(timing.time, "perf_counter", lambda: clock.now)
    calls = []

    class Fake(timing.Probe):
        units = 10.0

        def __init__(self, name, durations):
            self.name, self.durations = name, iter(durations)

        def call(self):
            calls.append(self.name)
            clock.now += next(self.durations)

        def prepare(self):
            calls.append("prepare")

        def rewind(self):
            calls.append("rewind")

    probes = [Fake("a", [9.0, 1.0, 3.0, 2.0]), Fake("b", [5.0, 4.0, 6.0, 7.0])]
    steps = []
    found = timing.take_turns(probes, repeats=2, least=0.5, told=lambda count: steps.append(count) or (lambda: None))
    assert [(t.ns, t.compile_s) for t in found] == [(2.0e9 / 10.0, 8.0), (6.0e9 / 10.0, 1.0)]
    first = ["a", "prepare", "rewind", "a", "b", "prepare", "rewind", "b"]
    assert calls == first + ["rewind", "a", "rewind", "b"] * 2
    assert steps == [6]


def test_a_turn_is_filled_with_calls(monkeypatch):
    clock = SimpleNamespace(now=0.0, calls=0)
    monkeypatch.setattr(timing.time, "perf_counter", lambda: clock.now)

    class Fake(timing.Probe):
        units = 1.0

        def call(self):
            clock.now += 0.25
            clock.calls += 1

        def prepare(self): ...
        def rewind(self): ...

    found = timing.take_turns([Fake()], repeats=3, least=1.0, told=lambda count: lambda: None)
    assert clock.calls == 2 + 3 * 4
    assert found[0].ns == pytest.approx(0.25e9)


def test_linear_growth_ends_before_the_first_cloth_that_costs_more():
    costs = {500: 2.0, 1500: 1.0, 5000: LINEAR, 20_000: 1.01 * LINEAR, 50_000: 1.0}
    rows = [row(vertices=n, ns_per_vertex_substep=ns) for n, ns in costs.items()]
    rows += [row(vertices=n, ns_per_vertex_substep=1.0, layout="mesh") for n in costs]
    rows += [row(vertices=90_000, solver="scalar")]
    assert linear_to(rows) == {"grid": 5000, "mesh": 50_000}


def test_the_gain_of_capes_is_against_one_core():
    rows = [row(section="capes", capes=4, threads=t, ns_per_vertex_substep=ns) for t, ns in ((1, 6.0), (2, 3.0))]
    assert gains(rows) == {4: 2.0}


def test_caches_are_read_in_bytes(tmp_path):
    for k, (level, kind, size) in enumerate([(1, "Data", "48K"), (1, "Instruction", "32K"), (3, "Unified", "32M")]):
        folder = tmp_path / f"index{k}"
        folder.mkdir()
        for name, text in (("level", level), ("type", kind), ("size", size)):
            (folder / name).write_text(f"{text}\n")
    assert caches(tmp_path) == {"L1d": 48 * 1024, "L3": 32 * 1024**2}
    assert caches(tmp_path / "nowhere") == {}


def test_the_plot_is_a_picture(report, tmp_path):
    pytest.importorskip("matplotlib")
    save_plot(report, tmp_path / "bench.png")
    data = (tmp_path / "bench.png").read_bytes()
    assert data.startswith(b"\x89PNG\r\n\x1a\n")
    width, height = struct.unpack(">II", data[16:24])
    assert (width, height) == (1560, 1080)
    assert len(data) > 30_000


def test_without_matplotlib_the_plot_says_what_to_install(report, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib", None)
    with pytest.raises(UserError, match=r"pip install 'cape\[plots\]'"):
        save_plot(report, tmp_path / "bench.png")


def test_a_folder_that_is_not_there_is_refused_before_anything_is_measured(tmp_path, forks):
    done = forks("bench", "-o", "nowhere", folder=tmp_path)
    assert (done.returncode, done.stdout) == (2, "")
    assert "nowhere" in done.stderr
    assert len(done.stderr.splitlines()) == 1
