"""Keyframes against closed forms, the frames that are taken of them, and which animation it is."""

import numpy as np
import pygltflib as gl
import pytest

import motions
from motions.errors import UnknownNameError, ValueRangeError
from motions.gltf.animation import Channel, frame_times
from tests.characters.builder import Glb, body, character

TIMES = np.array([1.0, 2.0, 4.0])


def test_steps_hold_and_lines_lead_on():
    values = np.array([[0.0, 0.0, 0.0], [1.0, 2.0, 3.0], [5.0, 0.0, 0.0]])
    asked = np.array([0.0, 1.0, 1.5, 2.0, 3.0, 9.0])
    step = Channel(0, "translation", TIMES, values, "STEP").at(asked)
    assert step[:, 0].tolist() == [0.0, 0.0, 0.0, 1.0, 1.0, 5.0]
    line = Channel(0, "translation", TIMES, values, "LINEAR").at(asked)
    assert line[:, 0].tolist() == [0.0, 0.0, 0.5, 1.0, 3.0, 5.0]
    assert line[2].tolist() == [0.5, 1.0, 1.5]


def test_a_step_is_taken_at_the_frame_that_rounding_puts_before_it():
    keys = np.arange(5).astype(np.float32) / np.float32(30.0)
    channel = Channel(0, "translation", keys.astype(float), np.arange(5.0)[:, None], "STEP")
    assert channel.at(np.arange(5) / 30.0).ravel().tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]


def test_a_spline_is_the_cubic_of_its_tangents():
    def cubic(t):
        return 2.0 * t**3 - t**2 + 3.0 * t - 1.0

    def slope(t):
        return 6.0 * t**2 - 2.0 * t + 3.0

    values = np.stack([slope(TIMES), cubic(TIMES), slope(TIMES)], axis=1)[..., None]
    asked = np.linspace(1.0, 4.0, 31)
    found = Channel(0, "scale", TIMES, values, "CUBICSPLINE").at(asked)
    assert np.allclose(found[:, 0], cubic(asked), atol=1e-12)  # a cubic is its own Hermite spline


def test_turns_take_the_shorter_way_at_constant_speed():
    half = np.radians([0.0, 40.0])  # of turns about Z by 0 and 80 degrees, the second with the other sign
    values = np.stack([np.cos(half), 0 * half, 0 * half, np.sin(half)], axis=1) * np.array([[1.0], [-1.0]])
    found = Channel(0, "rotation", np.array([0.0, 1.0]), values, "LINEAR").at(np.array([0.25]))[0]
    assert np.allclose(found * np.sign(found[0]), [np.cos(np.radians(10.0)), 0.0, 0.0, np.sin(np.radians(10.0))])


@pytest.mark.parametrize(
    ("keys", "fps", "frames"),
    [
        (np.arange(25) / 24.0, 24.0, 25),
        (0.5 + np.arange(31) / 30.0, 30.0, 31),
        (np.array([0.0, 1 / 30, 4 / 30, 5 / 30, 6 / 30]), 30.0, 7),  # keys left out where nothing happens
        (np.array([0.0, 1.0]), 60.0, 61),  # poses to go between
        (np.array([0.0, 0.031, 0.1]), 60.0, 7),
    ],
)
def test_frames_are_those_of_the_keys(keys, fps, frames):
    times, rate = frame_times([Channel(0, "scale", keys, np.zeros((len(keys), 3)), "LINEAR")], None)
    assert rate == fps
    assert len(times) == frames
    assert times[0] == keys[0]


def test_an_animation_is_taken_by_name(tmp_path):
    path = character(tmp_path / "hero.glb", body(), frames=3, clips=("Idle", "Walk"))
    first = motions.load(path)
    assert "animation: Idle, the first of Idle, Walk" in first.decisions[0]
    second = motions.load(path, animation="Walk")
    assert second.decisions == ()
    assert second.fps == pytest.approx(48.0)
    with pytest.raises(UnknownNameError, match=r"no animation named 'Wlak'; available: Idle, Walk; .*'Walk'"):
        motions.load(path, animation="Wlak")
    with pytest.raises(ValueRangeError, match="leave out the animation"):
        motions.load("walk", animation="Idle")


def test_a_figure_without_animation_stands(tmp_path):
    clip = motions.load(character(tmp_path / "hero.glb", body(), clips=()))
    assert (clip.frames, clip.fps) == (91, 30.0)
    assert "no animation moves the figure: it stands as it is for 3 s" in clip.decisions
    assert np.ptp(clip.world_positions(), axis=0).max() == 0.0


def test_scales_that_change_are_told(tmp_path):
    file = Glb()
    file.top.nodes = [gl.Node(name="A", children=[1]), gl.Node(name="B", translation=[0.0, 1.7, 0.0])]
    grown = np.array([[1.0, 1.0, 1.0], [2.0, 2.0, 2.0]])
    times, still = np.array([0.0, 0.1]), np.tile([0.0, 1.7, 0.0], (2, 1))
    file.animate("Grow", [(0, "scale", times, grown, "LINEAR"), (1, "translation", times, still, "LINEAR")])
    clip = motions.load(file.write(tmp_path / "a.glb"), unit="m")
    assert any("scales that change in the motion stay as they are at first: A, B" in each for each in clip.decisions)
    # Places follow all the same: B moves away as A grows.
    assert clip.world_positions()[-1, 1, 2] == pytest.approx(3.4, abs=1e-6)
