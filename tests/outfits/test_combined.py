"""Several cloths as one: the same springs and masses, layers that meet, takes apart."""

import json

import numpy as np
import pytest

import cape
import motions
import skeleton
from cape.assembly.self_contact import rest_shape
from cape.assembly.springs import springs_of
from cape.cloth.split_mesh import SplitMesh
from cape.cloth.triangle_mesh import reordered
from cape.measure.self_crossings import self_crossings, share_crossed
from cape.outfits.apart import takes_apart
from cape.outfits.combined import Outfit, as_mesh, combined, started_at
from cape.outfits.girding import Band, girded, hangs_out
from cape.record import save
from cape.scene.standard_scenes import frame_times, track_of
from motions.errors import UnknownNameError, ValueRangeError
from tests.record.test_record import Recording
from tests.support.processes import mistake_told


@pytest.fixture(scope="module")
def walker() -> tuple[skeleton.Skeleton, skeleton.BoneTrack]:
    clip = motions.load("walk").trim(0.0, 0.1)
    body = skeleton.Skeleton.from_clip(clip)
    return body, body.track(clip)


def sheet(size: float = 0.5, height: float = 0.0, spacing: float = 0.05) -> cape.GridCloth:
    return cape.Cloth.rectangle(
        width=size, height=size, spacing=spacing, origin=(-size / 2, -size / 2, height), right=(0, 1, 0), down=(1, 0, 0)
    )


@pytest.mark.parametrize("garment", ["back_cape", "shoulder_cape"])
def test_a_mesh_of_a_grid_has_its_masses_its_threads_and_their_lengths(garment, walker):
    grid = cape.dress(*walker, garment=garment, spacing=0.08).cloth
    assert isinstance(grid, cape.GridCloth)
    mesh = as_mesh(grid)
    # A gathered cell has more warp than weft: that its triangles tell their own masses is all that may differ.
    np.testing.assert_allclose(mesh.masses(), grid.masses(), rtol=1e-9)
    assert np.array_equal(mesh.triangles, grid.triangles)
    assert mesh.threads is not None
    assert len(mesh.threads) == grid.rows * (grid.columns - 1) + grid.columns * (grid.rows - 1)
    for corners, own in zip(mesh.corners, grid.corners_at_rest, strict=True):
        for first, second in ((0, 1), (1, 2), (2, 0)):
            length = np.linalg.norm(own[first] - own[second])
            assert np.linalg.norm(corners[first] - corners[second]) == pytest.approx(length, rel=1e-9)


def test_springs_of_cloths_together_are_those_of_each():
    one, other = sheet(), cape.Cloth.skirt(waist=0.8, length=0.3, spacing=0.08)
    outfit = combined(["one", "other"], [one, other], [one.positions, other.positions])
    both, own = springs_of(outfit), [springs_of(as_mesh(cloth)) for cloth in (one, other)]
    starts = [part.start for part in outfit.parts]
    assert starts == [0, one.vertices]
    for name in ("first", "second"):
        apart = [getattr(springs, name) + start for springs, start in zip(own, starts, strict=True)]
        assert np.array_equal(getattr(both, name), np.concatenate(apart))
    for name in ("rest", "stiffness"):
        apart = np.concatenate([getattr(springs, name) for springs in own])
        np.testing.assert_allclose(getattr(both, name), apart, rtol=1e-9)
    assert np.array_equal(outfit.region("other.hem"), other.region("hem") + one.vertices)
    np.testing.assert_allclose(outfit.masses(), np.concatenate([one.masses(), other.masses()]))


def falling(self_contact: cape.SelfContact | None) -> cape.Scene:
    """A sheet that is held all around, and a smaller one that falls onto it."""
    below, above = sheet(0.6), sheet(0.35, 0.06)
    outfit = combined(["below", "above"], [below, above], [below.positions, above.positions])
    rim = np.unique(np.concatenate([below.region(side) for side in ("top", "bottom", "left", "right")]))
    return cape.Scene(
        outfit, [cape.attach(outfit, "frame", rim)], wind=cape.Wind(), self_contact=self_contact, strain_limit=True
    )


def fallen(self_contact: cape.SelfContact | None, threads: int = 1) -> cape.Take:
    times = frame_times(0.4)
    track = track_of(times, frame=np.zeros((len(times), 3)))
    return cape.simulate(falling(self_contact), track, threads=threads, settle=0.0)


@pytest.fixture(scope="module")
def lying() -> cape.Take:
    return fallen(cape.SelfContact())


def test_a_cloth_lies_on_another_and_falls_through_where_layers_do_not_meet(lying):
    take = lying
    assert take.result == "finished"
    below, above = (part.vertices for part in take.cloth.parts)
    lowest, sag = take.positions[-1, above, 2].min(), take.positions[-1, below, 2].min()
    assert lowest > sag
    for frame in take.positions[::4]:
        assert len(self_crossings(frame, take.triangles)) == 0
    # In 0.4 s it would have fallen by 0.78 m, less what the air brakes.
    through = fallen(None)
    assert through.positions[-1, above, 2].max() < -0.2


def test_the_same_bits_on_any_number_of_threads(lying):
    assert np.array_equal(lying.positions, fallen(cape.SelfContact(), threads=2).positions)


def test_a_take_comes_apart(lying, tmp_path):
    take = lying
    above, below = takes_apart(take)
    assert (above.name, below.name) == ("above", "below")
    assert np.array_equal(np.concatenate([below.positions, above.positions], axis=1), take.positions)
    assert len(above.held) == 0
    assert np.array_equal(below.held, take.held)
    assert np.maximum(above.stretch_max, below.stretch_max) == pytest.approx(take.stretch_max, abs=1e-5)
    assert takes_apart(above) == [above]
    save(take, tmp_path / "both.rrd")
    drawn = Recording(tmp_path / "both.rrd")
    assert {"/world/cloths/above", "/world/cloths/below"} <= drawn.entities
    assert "/world/cape" not in drawn.entities


def test_a_cape_over_a_skirt_starts_outside_of_it_and_stays_there(walker):
    body, track = walker
    scene = cape.dress(body, track, garments=["back_cape", "skirt"], spacing=0.1)
    assert isinstance(scene.cloth, Outfit)
    assert [part.name for part in scene.cloth.parts] == ["skirt", "back_cape"]
    assert {collider.name for collider in scene.colliders} == {
        collider.name for collider in cape.dress(body, track, garment="skirt").colliders
    }
    take = cape.simulate(scene, track)
    assert take.result == "finished"
    starts = [part.start for part in scene.cloth.parts]
    owner = np.searchsorted(starts, scene.cloth.faces[:, 0], side="right")
    for frame in take.positions:
        pairs = owner[self_crossings(frame, take.triangles)]
        assert (pairs[:, 0] == pairs[:, 1]).all()


def test_what_can_not_be_worn_together_is_told(walker):
    with pytest.raises(ValueRangeError, match="worn once"):
        cape.dress(*walker, garments=["skirt", "skirt"])
    with pytest.raises(ValueRangeError, match="not none"):
        cape.dress(*walker, garments=[])
    with pytest.raises(UnknownNameError, match="toga"):
        cape.dress(*walker, garments=["toga", "skirt"])
    one = sheet()
    with pytest.raises(ValueRangeError, match="different names"):
        combined(["one", "one"], [one, one], [one.positions, one.positions])


@pytest.mark.parametrize("alone", [False, True])
def test_what_starts_close_together_meets_though_it_is_nearer_than_the_thickness(alone):
    """The upper half of a sheet that is folded over itself lies down on the lower one, which is held."""
    cloth, gap, spacing = sheet(), 0.002, 0.05
    along = cloth.pattern[:, 1]
    places = np.column_stack([cloth.pattern[:, 0], np.minimum(along, 0.5 - along), np.where(along > 0.26, gap, 0.0)])
    worn = started_at(cloth, places) if alone else combined(["far", "folded"], [cloth] * 2, [places + 9.0, places])
    own = np.arange(worn.vertices)[-cloth.vertices :]
    lower, upper = own[along < 0.26], own[along > 0.25 + 1.5 * spacing]
    simulation = cape.Simulation(cape.Scene(worn, [cape.attach(worn, "table", lower)], self_contact=cape.SelfContact()))
    table = {"table": (np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))}
    simulation.start(table)
    for _ in range(30):
        simulation.step(table, 1.0 / 60.0)
    assert len(self_crossings(simulation.positions, worn.triangles)) == 0
    # What it lacks of 5 mm in the end, it gets by all but 1 / e in 0.3 s.
    least = 0.005 - (0.005 - gap) * np.exp(-0.5 / 0.3)
    assert simulation.positions[upper, 2].min() > least - 0.02 * 0.005


def test_where_a_cloth_is_at_rest_follows_its_vertices():
    cloth = cape.Cloth.skirt(waist=0.8, length=0.3, spacing=0.08)
    mesh = started_at(cloth, 0.5 * cloth.positions)
    np.testing.assert_array_equal(rest_shape(mesh), rest_shape(cloth))
    order = np.random.default_rng(0).permutation(mesh.vertices)
    np.testing.assert_array_equal(rest_shape(reordered(mesh, order)), rest_shape(cloth)[order])
    slit = cape.cut(mesh, along=mesh.positions[[mesh.region("hem")[0], mesh.region("waist")[0]]])
    parents = np.linalg.norm(slit.positions[:, None] - mesh.positions, axis=2).argmin(axis=1)
    split = SplitMesh.of(mesh, order, 9).split(slit.faces, parents)
    assert mesh.rest is not None
    assert slit.rest is not None
    assert split.rest is not None
    assert len(parents) > mesh.vertices
    np.testing.assert_array_equal(slit.rest, mesh.rest[parents])
    np.testing.assert_array_equal(split.rest[: split.in_use], mesh.rest[order[split.parents]])
    assert len(split.rest) == split.vertices


def test_cloths_that_cross_at_the_start_are_refused(walker, monkeypatch):
    from cape.outfits import dressing

    monkeypatch.setattr(dressing, "_stand_in", lambda *_: [])
    with pytest.raises(ValueRangeError, match="back_cape can't be put on over the skirt: they pass through each other"):
        cape.dress(*walker, garments=["back_cape", "skirt"], spacing=0.1)


def ring(radii: tuple[float, float], heights: tuple[float, ...]) -> np.ndarray:
    """Points around the origin's vertical, wider to the left than ahead."""
    angles = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    level = np.stack([radii[0] * np.cos(angles), radii[1] * np.sin(angles)], axis=1)
    return np.concatenate([np.column_stack([level, np.full(40, height)]) for height in heights])


@pytest.mark.parametrize("turn", [0.0, 0.7])
def test_a_flat_panel_is_laid_around_the_body_thread_along_thread(turn):
    """In front of an upright cylinder: what is a sixth of the way around from its middle comes to be 60 degrees off."""
    c, s = np.cos(turn), np.sin(turn)
    turned = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    # Hardly wider than deep, which tells where sides are.
    band = Band("pelvis", ring((0.2, 0.2 + 1e-6), (1.0, 1.05)) @ turned.T, 0.01)
    across = np.linspace(-0.19 * np.pi / 3.0, 0.19 * np.pi / 3.0, 13)
    panel = np.stack([np.full(13, 0.3), across, np.full(13, 1.02)], axis=1)
    above = panel + np.array([0.0, 0.0, 0.2])
    vertices, within = girded(np.concatenate([above, panel]) @ turned.T, band)
    assert sorted(vertices) == list(range(13, 26))
    places = (within @ turned)[np.argsort(vertices)]
    np.testing.assert_allclose(np.hypot(places[:, 0], places[:, 1]), 0.19, rtol=0.01)
    np.testing.assert_allclose(np.arctan2(places[:, 1], places[:, 0]), across / 0.2, atol=0.02)
    assert (places[:, 2] == 1.02).all()
    assert hangs_out(panel @ turned.T, [band])
    assert not hangs_out(panel * [0.5, 0.5, 1.0], [band])
    assert not hangs_out(above, [band])
    # A band of a single row is as wide everywhere.
    row = Band("pelvis", ring((0.2, 0.2 + 1e-6), (1.02,)) @ turned.T, 0.01)
    alone, inside = girded(panel @ turned.T, row)
    np.testing.assert_allclose(inside[np.argsort(alone)], within[np.argsort(vertices)], atol=1e-3)


def test_panels_too_wide_for_a_band_are_gathered_and_do_not_meet_at_the_sides():
    band = Band("pelvis", ring((0.12, 0.16), (1.0, 1.04)), 0.01)
    across = np.linspace(-0.4, 0.4, 41)
    front = np.stack([np.full(41, 0.15), across, np.full(41, 1.02)], axis=1)
    vertices, within = girded(np.concatenate([front, front * [-1.0, 1.0, 1.0]]), band)
    assert len(vertices) == 82
    places = within[np.argsort(vertices)]
    assert (np.diff(np.arctan2(places[:41, 1], places[:41, 0])) > 0.0).all()  # in the order of the panel
    ahead, behind = places[[0, 40]], places[[41, 81]]
    assert (np.linalg.norm(ahead - behind, axis=1) > 0.008).all()


@pytest.mark.parametrize(("depth", "at_once"), [(0.03, False), (0.01, True), (-0.1, True)])
def test_what_starts_deep_in_those_below_is_let_out_in_stages(depth, at_once, walker, monkeypatch):
    from cape.outfits import dressing

    turn = np.array([np.cos(0.3), 0.0, 0.0, np.sin(0.3)])
    box = cape.Box(name="b", center=np.array([2.0, 0.0, 1.0]), half_sizes=np.array([0.3, 0.2, 0.1]), rotation_wxyz=turn)
    tried = []

    def settled(scene, track, settle):
        tried.append((len(scene.colliders), settle))
        return scene.cloth.positions + np.array([2.0, 0.0, 0.0])

    monkeypatch.setattr(dressing, "_settled", settled)
    dressing._come_to_rest(cape.Scene(sheet(0.1, 1.1 - depth)), [box], walker[1])
    assert ((1, None) in tried) == at_once
    assert len(tried) == (2 if at_once else 2 + dressing.STAGES)


@pytest.mark.extra
def test_three_garments_are_worn_over_each_other(walker):
    # Around a skirt a tabard starts so deep in what keeps it off that it has to be let out.
    scene = cape.dress(*walker, garments=["shoulder_cape", "tabard", "skirt"], spacing=0.04)
    assert isinstance(scene.cloth, Outfit)
    assert [part.name for part in scene.cloth.parts] == ["skirt", "tabard", "shoulder_cape"]
    assert len(self_crossings(scene.cloth.positions, scene.cloth.triangles)) == 0
    take = cape.simulate(scene, walker[1])
    assert take.result == "finished"
    assert take.penetration.max() < 0.001
    assert share_crossed(take.positions, scene.cloth.triangles, most=len(take.positions)) == 0.0


@pytest.mark.extra
@pytest.mark.parametrize("spacing", [None, 0.04])
def test_a_skirt_is_put_on_over_a_tabard_which_it_gathers(spacing, walker):
    scene = cape.dress(*walker, garments=["shoulder_cape", "skirt", "tabard"], spacing=spacing)
    assert len(self_crossings(scene.cloth.positions, scene.cloth.triangles)) == 0
    take = cape.simulate(scene, walker[1])
    assert take.result == "finished"
    assert take.stretch_max[1:].max() < 0.06
    assert share_crossed(take.positions, scene.cloth.triangles, most=len(take.positions)) == 0.0


@pytest.mark.extra
def test_a_tabard_at_its_own_spacing_is_put_on_over_a_skirt():
    clip = motions.load("walk").trim(0.0, 0.6)
    body = skeleton.Skeleton.from_clip(clip)
    scene = cape.dress(body, body.track(clip), garments=["shoulder_cape", "tabard", "skirt"])
    assert len(self_crossings(scene.cloth.positions, scene.cloth.triangles)) == 0


@pytest.mark.extra
def test_the_command_puts_garments_on_over_each_other(forks, tmp_path):
    done = forks(
        "replay", "walk", "--garment", "back_cape", "--garment", "skirt", "--spacing", "0.1", "--end", "0.1", "--json",
        folder=tmp_path,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    facts = json.loads(done.stdout)
    assert facts["garments"] == ["back_cape", "skirt"]
    assert facts["result"] == "finished"
    drawn = Recording(tmp_path / "walk.rrd").entities
    assert {"/world/cloths/back_cape", "/world/cloths/skirt"} <= drawn
    _, line = mistake_told(forks("replay", "walk", "--garment", "skirt", "--garment", "skirt", folder=tmp_path))
    assert "worn once" in line
