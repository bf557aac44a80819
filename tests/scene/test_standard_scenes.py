"""The standard scenes are what their names and descriptions say."""

import numpy as np
import pytest

from cape import Simulation, SymplecticEuler
from cape.cloth.cloth import GridCloth
from cape.scene.standard_scenes import FPS, STANDARD_SCENES, standard_scene, worn
from motions.errors import UnknownNameError


@pytest.mark.parametrize("name", STANDARD_SCENES)
def test_a_named_scene_builds_and_its_track_moves_all_its_bones(name: str):
    standard = standard_scene(name)
    assert standard.name == name
    for bone in standard.scene.bones:
        standard.track.index(bone)  # raises for a bone that it lacks
    assert standard.smooth == (name in ("swing", "stiff"))
    # What repeats a second of the motion begins after the first.
    assert standard.track.times[-1] >= 2.0


def test_an_unknown_name_is_refused_with_those_that_exist():
    with pytest.raises(
        UnknownNameError, match=r"no standard scene named 'hop'; available: swing, flag, .*, fine, torn, caught$"
    ):
        standard_scene("hop")


def test_the_swing_sets_out_from_rest_and_goes_forth_and_back_by_15_cm_in_two_seconds():
    x = standard_scene("swing").track.positions[:, 0, 0]
    # The ramp, r = 2 t, is at most 10 r^3 and the sine at most its angle: no kink at the start.
    assert 0.0 < x[1] <= 0.15 * 10.0 * (2.0 / FPS) ** 3 * np.pi / FPS
    quarter = round(FPS / 2)
    np.testing.assert_allclose(x[quarter :: 4 * quarter], 0.15)
    np.testing.assert_allclose(x[3 * quarter :: 4 * quarter], -0.15)


def test_what_is_called_smooth_hardly_depends_on_where_it_starts():
    standard = standard_scene("swing")
    track, ends = standard.track, []
    for nudge in (0.0, 1e-9):
        simulation = Simulation(standard.scene, solver=SymplecticEuler(precision="double"))
        simulation.start({"rod": (track.positions[0, 0], track.rotations_wxyz[0, 0])})
        simulation.disturb(nudge * np.random.default_rng(1).standard_normal(simulation.positions.shape))
        for frame in range(1, track.frames):
            simulation.step({"rod": (track.positions[frame, 0], track.rotations_wxyz[frame, 0])}, 1.0 / FPS)
        ends.append(simulation.positions)
    # Where a sheet buckles, as this one would at twice the frequency, a nanometre becomes centimetres.
    assert np.abs(ends[1] - ends[0]).max() < 1e4 * 1e-9


@pytest.mark.parametrize("name", ["sphere", "cube"])
def test_a_sheet_falls_onto_a_shape_from_10_cm_above_its_middle(name: str):
    cloth = standard_scene(name).scene.cloth
    np.testing.assert_allclose(cloth.positions[:, 2], 0.3 + 0.1)
    np.testing.assert_allclose(cloth.positions.mean(axis=0)[:2], 0.0, atol=1e-12)


def test_the_stiff_scene_is_the_swing_with_stiffer_threads():
    stiff, swing = (standard_scene(name).scene.cloth for name in ("stiff", "swing"))
    np.testing.assert_array_equal(stiff.positions, swing.positions)
    assert (stiff.fabric.stretch, stiff.fabric.shear) == (1e6, 1e5)
    assert stiff.fabric.stretch_warp > 100 * swing.fabric.stretch_warp


@pytest.mark.parametrize("vertices", [500, 3000, 20_000])
def test_a_worn_cape_has_about_as_many_vertices_as_asked_for(vertices: int):
    usual, cloth = worn("walk").scene.cloth, worn("walk", vertices=vertices).scene.cloth
    assert isinstance(usual, GridCloth)
    # The spacing is scaled by areas, as if each vertex had one cell; there is one more than cells in a row or column.
    assert cloth.vertices == pytest.approx(vertices, rel=1 / usual.rows + 1 / usual.columns)
