"""The same motion in other frames a second, or in another unit of length, moves the same cape in the same way."""

from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import cape
import motions
from cape import XPBD, Solver, SymplecticEuler
from cape.report.measured.resolution import chain_period
from cape.scene.standard_scenes import swing
from skeleton import Skeleton
from skeleton.track import BoneTrack

SECONDS = 1.5
SPACING = 0.06
STEPS = 4800  # a second, where all runs are to take as many
FINEST = 480  # frames a second; a multiple of all others
COMPARED = 30  # frames a second that all have

FIXED: dict[str, Callable[[int], Solver]] = {
    "euler": lambda fps: SymplecticEuler(precision="double", substeps=STEPS // fps),
    "xpbd": lambda fps: XPBD(precision="double", substeps=STEPS // fps),
}
EVERY: dict[str, Callable[[int], Solver]] = {"default": lambda fps: SymplecticEuler(), **FIXED}


def moved(track: BoneTrack, solver: Solver) -> cape.Take:
    """The sheet of the standard swing, moved by a track of its rod."""
    return cape.simulate(swing(spacing=SPACING, seconds=SECONDS).scene, track, solver=solver, threads=1)


@cache
def swung(name: str, fps: int) -> cape.Take:
    """The swing told in so many frames a second."""
    return moved(swing(spacing=SPACING, seconds=SECONDS, fps=fps).track, EVERY[name](fps))


def farthest(one: cape.Take, other: cape.Take) -> float:
    """Largest distance of vertices at the times that two runs have in common [m]."""
    a, b = (take.positions[:: round(take.bones.fps) // COMPARED].astype(float) for take in (one, other))
    assert a.shape == b.shape == (round(SECONDS * COMPARED) + 1, *one.positions.shape[1:])
    return float(np.linalg.norm(a - b, axis=2).max())


def greatest_acceleration() -> float:
    """Of the rod [m/s2]."""
    fps = 10 * FINEST
    places = swing(spacing=SPACING, seconds=SECONDS, fps=fps).track.positions[:, 0, 0]
    return float(np.abs(np.diff(places, 2)).max()) * fps**2


def interpolation_error(fps: int) -> float:
    """How far the hem may be off because bones move in straight lines between frames [m].

    The rod itself is off by e <= h^2 / 8 max |a|. The sheet swings like a chain: of a motion e of its upper end its
    slowest swing gets the share 2 / (j01 J1(j01)) = 1.6 at the hem. Its part q that is not carried along obeys
    q'' + w^2 q = -1.6 e''; by Duhamel's integral, integrated by parts twice with e = e' = 0 at the start, it is
    -1.6 (e - w times the integral of sin(w (t - s)) e(s) ds), at most 1.6 (1 + w t) max e. Faster swings get smaller
    shares, and are left out.
    """
    slowest = 2.0 * np.pi / chain_period(1.2, 9.81)
    return (1.0 + 1.6 * (1.0 + slowest * SECONDS)) * greatest_acceleration() / (8.0 * fps**2)


def step_error(name: str) -> float:
    """How far two runs of symplectic Euler in steps of different lengths may be apart [m]; the same steps are not.

    To first order, it is a method of second order whose velocities are half a step late (Hairer, Lubich, Wanner 2003,
    "Geometric numerical integration illustrated by the Stoermer-Verlet method", section 1.3): positions are off by
    v dt / 2, in either run.
    """
    if name != "default":
        return 0.0
    finest = swung(name, FINEST)
    speed = float(np.linalg.norm(np.diff(finest.positions.astype(float), axis=0), axis=2).max()) * FINEST
    return speed / (COMPARED * swung(name, COMPARED).substeps)


@pytest.mark.parametrize("fps", [30, 60, 120, 240])
@pytest.mark.parametrize("name", EVERY)
@pytest.mark.few("default-30", "euler-120", "xpbd-240")
def test_a_motion_told_in_other_frames_moves_the_cloth_in_the_same_way(name: str, fps: int):
    take, finest = swung(name, fps), swung(name, FINEST)
    assert take.result == finest.result == "finished"
    tolerance = interpolation_error(fps) + interpolation_error(FINEST) + step_error(name)
    assert farthest(take, finest) < tolerance
    # And that is little next to how far the cloth gets.
    assert tolerance < 0.02 * np.ptp(finest.positions[..., 0])


def test_what_frames_leave_out_shrinks_with_the_square_of_their_length():
    off = [farthest(swung("xpbd", fps), swung("xpbd", FINEST)) for fps in (30, 60, 120)]
    # The finest is off as well: of the squares of lengths, in its own, 1 is to be subtracted.
    expected = [(FINEST / fps) ** 2 - 1.0 for fps in (30, 60, 120)]
    orders = [2.0 * np.log(off[k] / off[k + 1]) / np.log(expected[k] / expected[k + 1]) for k in range(2)]
    np.testing.assert_allclose(orders, 2.0, atol=0.2)


@pytest.mark.parametrize("name", FIXED)
def test_frames_between_frames_change_nothing(name: str):
    track = swing(spacing=SPACING, seconds=SECONDS, fps=30).track
    coarse, cut = moved(track, FIXED[name](30)), moved(track.resample(240.0), FIXED[name](240))
    assert cut.positions.shape[0] == 8 * (coarse.positions.shape[0] - 1) + 1
    # The same steps to the last digits of a double, and kept in single precision: half a digit of 2 m, twice.
    assert farthest(coarse, cut) < 2.0 * np.spacing(np.float32(1.5))


# -- units --


def worn(path: Path, *, unit: str | float, found: bool, frames: int, settle: float | None = None) -> cape.Take:
    """The first frames of a cape on a body whose walk was written in a unit, which is to be found out or told."""
    motions.save(motions.load("walk"), path, unit=unit, digits=17)
    clip = motions.load(path, unit=None if found else unit)
    body = Skeleton.from_clip(clip)
    track = body.track(clip)
    solver = XPBD(precision="double")
    scene = cape.dress(body, track, garment="back_cape", spacing=0.05, strain_limit=False)
    return cape.simulate(scene, track.first(frames), solver=solver, settle=settle)


@pytest.mark.parametrize("unit", ["m", "mm", "inch"])
def test_a_motion_in_another_unit_moves_the_same_cape(unit: str, tmp_path: Path):
    one, other = (worn(tmp_path / f"{name}.bvh", unit=name, found=True, frames=13, settle=0.0) for name in ("cm", unit))
    # A unit that is no power of two changes the last digit of a double, 1e-16 m. Thrown onto its shoulders, a cape
    # makes some 4e-9 m of it in ten frames, and centimetres in a second: which way it folds is chance.
    np.testing.assert_allclose(other.bones.positions, one.bones.positions, rtol=0.0, atol=1e-14)
    np.testing.assert_allclose(other.positions, one.positions, rtol=0.0, atol=1e-6)
    assert np.ptp(one.positions, axis=0).max() > 0.3


def test_a_motion_in_a_unit_that_rounds_nothing_moves_the_same_cape_to_the_last_bit(tmp_path: Path):
    one, other = (worn(tmp_path / "walk.bvh", unit=unit, found=False, frames=31) for unit in (1.0, 1.0 / 128.0))
    np.testing.assert_array_equal(other.bones.positions, one.bones.positions)
    np.testing.assert_array_equal(other.positions, one.positions)
    np.testing.assert_array_equal(other.penetration, one.penetration)
