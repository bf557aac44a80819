"""Cloths of different fabrics as one: each goes on as it would by itself, and looks like what it is of."""

import json
from dataclasses import replace

import numpy as np
import pytest

import cape
import skeleton
from cape.air.wind import Wind
from cape.assembly.fabrics import HELD
from cape.assembly.membrane import plane_stiffness
from cape.assembly.mesh.limits import limited_links
from cape.assembly.mesh.pieces import alike_pieces, pieces_of
from cape.assembly.springs import springs_of
from cape.assembly.stability import largest_step
from cape.cli.commands.replay import Cut
from cape.cli.options import cut
from cape.cli.scenes.file import scene_of
from cape.cli.scenes.writing import text_of
from cape.cloth.cloth import MeshCloth
from cape.cloth.fabric import Fabric
from cape.cloth.looks.registry import LOOKS
from cape.cloth.looks.sewn import texture_of
from cape.cloth.patches.patchwork import Patchwork
from cape.forces.elastic import Elastic
from cape.live.changes import Changes
from cape.live.rig import Rig
from cape.live.sources import TrackSource
from cape.measure.ledger import Balance, Ledger
from cape.outfits.apart import takes_apart
from cape.outfits.combined import Outfit, as_mesh, combined, of_fabric
from cape.record.worn import worn_of
from cape.run.simulation import Simulation
from cape.run.strain_limit import StrainLimit
from cape.scene.holding.attachments import attach
from cape.scene.scene import Scene
from cape.solvers import SOLVERS, XPBD, Solver
from cape.solvers.euler import SymplecticEuler
from motions.errors import FileError, UserError, ValueRangeError
from tests.live.rigs import Later, at_once
from tests.support.code import name_of, requests_of
from tests.support.processes import mistake_told
from tests.support.scenes import DOUBLE, Run, every_solver, grid_cloth, irregular, turn_about, walking

HEAVY = Fabric(density=0.4, stretch=(3000.0, 1500.0), shear=150.0, bend=(4e-5, 1e-5))
LIGHT = Fabric(density=0.1, stretch=400.0, shear=10.0, bend=2e-6)
# The same, and other damping than the first has.
LIVELY = replace(LIGHT, damping_time=2e-4, bend_damping_time=1e-4)
STEADY = replace(LIGHT, bend_damping_time=2e-2)
LAYOUTS = ("springs", "membrane")


def sheet(fabric: Fabric, layout: str = "springs", *, aside: float = 0.0) -> MeshCloth:
    """A sheet that hangs down, longer than wide, so that alone and with others vertices are sorted in the same way."""
    u, v = np.linspace(0.0, 0.3, 8), np.linspace(0.0, 0.42, 10)
    grid = grid_cloth(u, v, fabric, right=(0.0, 1.0, 0.0), origin=(aside, 0.0, 1.0))
    return as_mesh(grid) if layout == "springs" else irregular(grid, np.random.default_rng(1))


def apart(layout: str = "springs", fabrics: tuple[Fabric, Fabric] = (HEAVY, LIVELY)) -> tuple[Outfit, list[MeshCloth]]:
    """Two sheets, one before the other, as one cloth, and each by itself."""
    sheets = [sheet(fabrics[0], layout), sheet(fabrics[1], layout, aside=0.1)]
    return combined(["one", "other"], sheets, [each.positions for each in sheets]), sheets


def held(cloth: MeshCloth, *, limit: bool = False) -> Scene:
    top = np.flatnonzero(cloth.positions[:, 2] > 0.999)
    air = Wind(velocity=(2.0, 0.0, 0.0), viscous=0.2)
    return Scene(cloth, [attach(cloth, "rod", top)], wind=air, strain_limit=limit)


def moved(scene: Scene, solver: Solver, substeps: int, *, frames: int = 4, threads: int = 1) -> Run:
    run = Run(scene, solver, threads=threads)
    for frame in range(1, frames + 1):
        run.step(1 / 60, substeps, ([[0.02 * frame, 0.0, 0.01 * frame]], [turn_about((0.0, 0.0, 1.0), 0.05 * frame)]))
    return run


def steps_of(scene: Scene, solver: Solver) -> int:
    if isinstance(solver, SymplecticEuler):
        return 2 * Run(scene, solver).stable_substeps()
    return 40 if isinstance(solver, XPBD) else 4


@pytest.mark.parametrize("layout", LAYOUTS)
def test_masses_springs_and_energy_are_those_of_each(layout: str):
    outfit, sheets = apart(layout)
    both, own = springs_of(outfit), [springs_of(each) for each in sheets]
    assert (both.membrane is not None) == (layout == "membrane")
    np.testing.assert_allclose(outfit.masses(), np.concatenate([each.masses() for each in sheets]), rtol=1e-12)
    for name in ("stiffness", "rest", "bend_stiffness", *(["nearest"] if layout == "membrane" else [])):
        np.testing.assert_allclose(getattr(both, name), np.concatenate([getattr(each, name) for each in own]))
    whole = Run(held(outfit), DOUBLE[0]).assembly
    places = outfit.positions * 1.02 + 0.002 * np.random.default_rng(0).standard_normal(outfit.positions.shape)
    count = sheets[0].vertices
    told = [
        Elastic.energy(run.assembly, run.assembly.inwards(own))
        for run, own in zip((Run(held(s), DOUBLE[0]) for s in sheets), (places[:count], places[count:]), strict=True)
    ]
    assert Elastic.energy(whole, whole.inwards(places)) == pytest.approx(sum(told), rel=1e-12)


@every_solver
@pytest.mark.parametrize("layout", LAYOUTS)
@pytest.mark.parametrize("other", [LIGHT, LIVELY, STEADY], ids=["damped alike", "damped apart", "bends apart"])
def test_cloths_that_never_meet_move_as_each_by_itself(other: Fabric, layout: str, solver: Solver):
    outfit, sheets = apart(layout, (HEAVY, other))
    scene = held(outfit)
    substeps = steps_of(scene, solver)
    together = moved(scene, solver, substeps).positions
    alone = np.concatenate([moved(held(each), solver, substeps).positions for each in sheets])
    # What a stage is solved to is seen over all vertices: the implicit ones come as near as they are solved.
    np.testing.assert_allclose(together, alone, atol=1e-10 if solver in DOUBLE else 2e-8)
    assert np.abs(alone - outfit.positions).max() > 0.02


@pytest.mark.parametrize("layout", LAYOUTS)
def test_energy_is_accounted_for_as_that_of_each(layout: str):
    def balance(cloth: MeshCloth) -> Balance:
        simulation = Simulation(held(cloth), solver=SymplecticEuler(substeps=80), threads=1, ledger=Ledger())
        simulation.start({"rod": (np.zeros(3), [1.0, 0.0, 0.0, 0.0])}, settle=0.0)
        for frame in range(1, 9):
            simulation.step({"rod": (np.array([0.02 * frame, 0.0, 0.0]), [1.0, 0.0, 0.0, 0.0])}, 1 / 60)
        assert simulation.ledger is not None
        return simulation.ledger.balance

    outfit, sheets = apart(layout)
    together, *alone = (balance(cloth) for cloth in (outfit, *sheets))
    for name in ("kinetic", "elastic", "damping", "air", "attachments"):
        each = [getattr(balance, name)[-1] for balance in alone]
        assert getattr(together, name)[-1] == pytest.approx(sum(each), rel=1e-3)
    assert min(balance.damping[-1] for balance in alone) > 0.0
    assert abs(together.residual[-1]) < 1e-6 * together.attachments[-1]


@every_solver
def test_fabrics_differ_in_what_becomes_of_them(solver: Solver):
    """What is told apart above is: the same sheets of one fabric move otherwise."""
    outfit, _ = apart()
    substeps = steps_of(held(outfit), solver)
    other = replace(outfit, fabric=HEAVY, patchwork=None)
    several, one = (moved(held(each), solver, substeps).positions for each in (outfit, other))
    count = outfit.parts[1].start
    np.testing.assert_allclose(several[:count], one[:count], atol=2e-8)
    assert np.abs(several[count:] - one[count:]).max() > 1e-3


@every_solver
@pytest.mark.parametrize("layout", LAYOUTS)
def test_the_same_bits_on_any_number_of_threads(layout: str, solver: Solver):
    outfit, _ = apart(layout)
    assert outfit.vertices > 2 * 64
    scene = held(outfit)
    substeps = steps_of(scene, solver)
    one, two = (moved(scene, solver, substeps, frames=2, threads=threads).positions for threads in (1, 2))
    assert np.array_equal(one, two)


@pytest.mark.parametrize("layout", LAYOUTS)
def test_the_largest_step_is_that_of_the_piece_that_needs_the_shortest(layout: str):
    outfit, sheets = apart(layout)
    whole, euler = Run(held(outfit), DOUBLE[0]), SymplecticEuler()
    arrays = euler.arrays(whole.assembly)
    alone = [euler.arrays(Run(held(each), DOUBLE[0]).assembly) for each in sheets]
    assert alone[0].stable_step != pytest.approx(alone[1].stable_step, rel=0.05)
    for name in ("stable_step", "strained_step"):
        assert getattr(arrays, name) == pytest.approx(min(getattr(each, name) for each in alone), rel=1e-3)
    # Damping counts where it is: that of the second would shorten the steps of the first.
    springs, light = whole.assembly.springs, whole.assembly.inverse_mass
    if layout == "springs":
        assert largest_step(springs, LIVELY, light, whole.assembly.cloth.positions) < 0.9 * arrays.stable_step


def test_pieces_are_told_apart_where_kernels_take_one_number_for_all():
    outfit, sheets = apart("membrane", (HEAVY, LIGHT))
    springs = springs_of(outfit)
    assert [piece.fabric for piece in pieces_of(outfit, springs)] == [HEAVY, LIGHT]
    planes = [piece.springs.membrane.stiffness for piece in alike_pieces(outfit, springs) if piece.springs.membrane]
    np.testing.assert_array_equal(planes, [plane_stiffness(HEAVY), plane_stiffness(LIGHT)])
    outfit, sheets = apart("springs", (HEAVY, LIGHT))
    springs = springs_of(outfit)
    (piece,) = alike_pieces(outfit, springs)
    assert piece.springs is springs
    first, second = pieces_of(outfit, springs)
    assert len(first.springs.first) == len(springs_of(sheets[0]).first)
    assert first.vertices.sum() == sheets[0].vertices
    assert not (first.vertices & second.vertices).any()
    assert len(first.springs.bend_stiffness) + len(second.springs.bend_stiffness) == len(springs.bend_stiffness)


@pytest.mark.parametrize("name", list(SOLVERS))
def test_several_fabrics_need_no_code_but_what_adds_up_pieces(name: str):
    def code(layout: str, fabrics: tuple[Fabric, Fabric]) -> set:
        return set(requests_of(held(apart(layout, fabrics)[0]), SOLVERS[name]()))

    def more(layout: str, fabrics: tuple[Fabric, Fabric]) -> set[str]:
        return {name_of(request) for request in code(layout, fabrics) - code(layout, (HEAVY, HEAVY))}

    assert combined(["a"], [sheet(HEAVY)], [sheet(HEAVY).positions]).patchwork is None
    assert code("springs", (HEAVY, LIGHT)) == code("springs", (HEAVY, HEAVY))
    assert more("springs", (HEAVY, LIVELY)) == ({"add_forces"} if name != "xpbd" else set())
    # Of a membrane also what leaves out the vertices of other pieces.
    several = more("membrane", (HEAVY, LIGHT))
    assert several == ({"add_forces"} | {unit for unit in several if "membrane" in unit} if name != "xpbd" else set())


def test_threads_may_get_as_long_as_the_fabric_of_each_lets_them():
    tight, loose = replace(LIGHT, strain_limit=(0.01, 0.02)), replace(LIGHT, strain_limit=(0.05, 0.06))
    outfit, sheets = apart("springs", (tight, loose))
    scene = held(outfit, limit=True)
    run = Run(scene, DOUBLE[0])
    links = limited_links(run.assembly, np.float64)
    assert links is not None
    springs = run.assembly.springs
    rest = dict(zip(zip(springs.first, springs.second, strict=True), springs.rest, strict=True))
    may = zip(links.first, links.second, links.longest, strict=True)
    assert {round(most / rest[a, b] - 1.0, 6) for a, b, most in may} == {
        round(HELD * each, 6) for each in (0.01, 0.02, 0.05, 0.06)
    }
    ties, attached = run.assembly.ties, run.assembly.attached
    assert ties is not None
    assert attached is not None
    pairs = zip(attached.vertices[ties.first], attached.vertices[ties.second], ties.longest, strict=True)
    assert {round(most / rest[a, b] - 1.0, 6) for a, b, most in pairs} == {
        round(HELD * each, 6) for each in (0.01, 0.05)
    }
    moving = moved(scene, DOUBLE[0], 400, frames=8).positions
    alone = np.concatenate([moved(held(each, limit=True), DOUBLE[0], 400, frames=8).positions for each in sheets])
    np.testing.assert_allclose(moving, alone, atol=1e-10)
    limit = StrainLimit(run.assembly, run.state, run.running.limits)

    def excess(first: float, second: float) -> float:
        """That of the sheets, each drawn out so much all over."""
        drawn = np.where(np.arange(outfit.vertices) < outfit.parts[1].start, first, second)
        places = run.assembly.inwards(outfit.positions * (1.0 + drawn)[:, None])
        for k in range(3):
            run.state[k][:] = places[:, k]
        return limit.excess()

    # Too much for the one, not for the other.
    assert excess(0.04, 0.04) == pytest.approx(0.04 - 0.02, abs=1e-9)
    assert excess(0.0, 0.04) == excess(0.0199, 0.0599) == 0.0
    assert excess(0.0, 0.08) == pytest.approx(0.08 - 0.06, abs=1e-9)


def test_the_energy_of_a_membrane_is_by_the_fabric_of_each():
    outfit, sheets = apart("membrane")
    places, vertices = outfit.positions * [1.0, 1.03, 1.01], sheets[0].vertices
    whole, own = springs_of(outfit).membrane, [springs_of(each).membrane for each in sheets]
    expected = 0.0
    for alone, there in zip(own, (places[:vertices], places[vertices:]), strict=True):
        assert alone is not None
        expected += alone.energy(there)
    assert whole is not None
    assert whole.energy(places) == pytest.approx(expected, rel=1e-12)


def test_what_a_mesh_of_several_fabrics_can_not_be_is_told():
    outfit, sheets = apart()
    with pytest.raises(ValueRangeError, match="leave out its patchwork"):
        Scene(replace(outfit, fabric=cape.FABRICS["denim"]))
    number = np.arange(len(sheets[0].faces)) % 2
    with pytest.raises(ValueRangeError, match="share a vertex"):
        Scene(replace(sheets[0], patchwork=Patchwork((HEAVY, LIGHT), number)))
    with pytest.raises(ValueRangeError, match="each of 126 triangles which of 2 fabrics"):
        Scene(replace(sheets[0], patchwork=Patchwork((HEAVY, LIGHT), number[1:])))
    with pytest.raises(ValueRangeError, match="of one fabric"):
        combined(["both", "one"], [outfit, sheets[0]], [outfit.positions, sheets[0].positions])
    denim = of_fabric(outfit, cape.FABRICS["denim"])
    assert isinstance(denim, Outfit)
    assert denim.patchwork is None
    assert {part.cloth.fabric for part in denim.parts} == {cape.FABRICS["denim"]}


# -- looks, and what changes them --


def test_a_live_run_has_all_of_another_fabric_and_is_put_on_anew_as_it_was():
    outfit, _ = apart()
    turns = np.tile([1.0, 0.0, 0.0, 0.0], (2, 1, 1))
    track = skeleton.BoneTrack(("rod",), np.arange(2) / 60, np.zeros((2, 1, 3)), turns)
    rig = Rig(held(outfit), TrackSource(track), SymplecticEuler(), threads=1)
    rig.start()
    rig.step(1 / 60)
    builder = Later()
    changes = Changes(rig, builder, at_once)

    def worn() -> Outfit:
        builder.work()
        builder.hand_over()
        rig.step(1 / 60)
        assert isinstance(rig.scene.cloth, Outfit)
        return rig.scene.cloth

    changes.reset()
    assert [part.cloth.fabric for part in worn().parts] == [HEAVY, LIVELY]
    changes.set_fabric("denim")
    changes.reset()
    cloth = worn()
    assert {cloth.fabric, *(part.cloth.fabric for part in cloth.parts)} == {cape.FABRICS["denim"]}
    assert cloth.masses().sum() == pytest.approx(2 * 0.3 * 0.42 * cape.FABRICS["denim"].density)


def test_each_is_drawn_and_kept_as_what_it_is_of(tmp_path):
    names = ("denim", "faille")
    outfit, _ = apart("springs", (cape.FABRICS[names[0]], cape.FABRICS[names[1]]))
    times = np.arange(2) / 60
    turns = np.tile([1.0, 0.0, 0.0, 0.0], (2, 1, 1))
    track = skeleton.BoneTrack(("rod",), times, np.zeros((2, 1, 3)), turns)
    take = cape.simulate(held(outfit), track, settle=0.0)
    take.keep(tmp_path / "both.npz")
    again = cape.Take.load(tmp_path / "both.npz")
    for each in (take, again):
        assert isinstance(each.cloth, Outfit)
        np.testing.assert_allclose(each.cloth.masses(), outfit.masses())
        worn = worn_of(takes_apart(each))
        assert [entity.look for entity in worn.cloths] == [LOOKS[name] for name in reversed(names)]
        # An export has one texture, over the pattern of both beside each other.
        texture = texture_of(each.cloth, LOOKS["faille"])
        places = np.round(each.cloth.texcoords * (np.array(texture.shape[1::-1]) - 1)).astype(int)
        for part, name in zip(each.cloth.parts, names, strict=True):
            u, v = places[part.vertices].T
            alone = texture_of(of_fabric(each.cloth, cape.FABRICS[name]), LOOKS[name])
            assert np.array_equal(texture[v, u], alone[v, u])


# -- on a character --


@pytest.fixture(scope="module")
def walker() -> tuple[skeleton.Skeleton, skeleton.BoneTrack]:
    return walking(0.1)


def test_garments_are_each_of_its_fabric(walker):
    denim, swim = cape.FABRICS["denim"], cape.FABRICS["swim"]
    scene = cape.dress(
        *walker, garments=["back_cape", "skirt"], spacing=0.1, fabric={"skirt": denim, "back_cape": swim}
    )
    assert isinstance(scene.cloth, Outfit)
    assert {part.name: part.cloth.fabric for part in scene.cloth.parts} == {"skirt": denim, "back_cape": swim}
    assert scene.cloth.fabric == swim
    skirt, above = (scene.cloth.masses()[part.vertices].sum() for part in scene.cloth.parts)
    plain = cape.dress(*walker, garments=["back_cape", "skirt"], spacing=0.1)
    assert isinstance(plain.cloth, Outfit)
    assert plain.cloth.patchwork is None
    usual = [plain.cloth.masses()[part.vertices].sum() for part in plain.cloth.parts]
    assert [skirt, above] == pytest.approx([usual[0] * denim.density / 0.2, usual[1] * swim.density / 0.2])
    take = cape.simulate(scene, walker[1])
    assert take.result == "finished"
    # One that is not named is of the usual fabric, and one that is worn alone may be named as well.
    alone = cape.dress(*walker, garment="skirt", spacing=0.1, fabric={"skirt": denim}).cloth
    assert alone.fabric == denim
    with pytest.raises(ValueRangeError, match="given for the cloak, but worn is: skirt"):
        cape.dress(*walker, garment="skirt", fabric={"cloak": denim})


# -- as asked for --


def asked(garments: list[str], fabrics: list[str]) -> Cut:
    return cut(garment=garments, fabric=fabrics)


def test_options_give_one_fabric_to_all_and_others_to_some():
    both = ["back_cape", "skirt"]
    assert asked(both, ["denim"]).fabric_names() == {"back_cape": "denim", "skirt": "denim"}
    assert asked(both, ["denim", "skirt=swim"]).fabric_names() == {"back_cape": "denim", "skirt": "swim"}
    assert asked(both, ["skirt=swim"]).fabric_names() == {"back_cape": "cape", "skirt": "swim"}
    assert asked([], []).fabric_names() == {"shoulder_cape": "cape"}
    for fabrics, told in (
        (["denim", "swim"], "one fabric for all, and GARMENT=FABRIC, not 'swim'"),
        (["sash=swim"], "tells of the sash, but worn is: back_cape, skirt"),
        (["skirt=steel"], "no fabric named 'steel'"),
        (["skirt="], "GARMENT=FABRIC"),
    ):
        with pytest.raises(UserError, match=told):
            asked(both, fabrics).check()


def test_a_scene_file_says_the_same(tmp_path):
    text = 'garment = ["back_cape", "skirt"]\nfabric = ["worsted", "skirt=velvet"]\n\n[fabrics.velvet]\ndensity = 0.5\n'
    scene = scene_of(text.encode(), tmp_path / "hero.toml")
    assert scene.options["fabric"] == ["worsted", "skirt=velvet"]
    again = scene_of(text_of(scene, scene.path).encode(), scene.path)
    assert (again.options, again.fabrics) == (scene.options, scene.fabrics)
    named = replace(asked(scene.options["garment"], scene.options["fabric"]), tables=scene.tables)
    named.check()
    assert named.fabric_names() == {"back_cape": "worsted", "skirt": "velvet"}
    assert scene.tables.fabric("velvet").density == 0.5
    for wrong, told in (("skirt=velvt", "line 2: .*'velvt'"), ("skrt=velvet", "line 2: .*'skrt'")):
        with pytest.raises(FileError, match=told):
            scene_of(text.replace("skirt=velvet", wrong).encode(), tmp_path / "hero.toml")


@pytest.mark.extra
def test_the_command_puts_on_garments_of_their_own_fabrics(forks, tmp_path):
    (tmp_path / "hero.toml").write_text(
        'clip = "walk"\nend = 0.1\nspacing = 0.1\ngarment = ["back_cape", "skirt"]\nfabric = ["swim", "skirt=heavy"]\n'
        '[fabrics.heavy]\nbase = "denim"\ndensity = 0.6\ndamping_time = 5e-5\n'
    )
    done = forks("replay", "--scene", "hero.toml", "--json", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    facts = json.loads(done.stdout)
    assert facts["fabrics"] == {"back_cape": "swim", "skirt": "heavy"}
    assert facts["result"] == "finished"
    told = forks("scene", "check", "hero.toml", folder=tmp_path)
    assert "back_cape of swim over skirt of heavy" in told.stdout
    _, line = mistake_told(forks("replay", "walk", "--garment", "skirt", "--fabric", "sash=denim", folder=tmp_path))
    assert "tells of the sash" in line
