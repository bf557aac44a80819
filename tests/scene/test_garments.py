"""Cloths other than capes, on any bone: skirts, banners, several on one character, bones of another simulator."""

import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import rerun as rr
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import ArrayLike

import cape
import motions
from cape import record
from cape.cloth.cloth import areas
from cape.cloth.looks.registry import LOOKS
from cape.cloth.triangle_mesh import edges_of
from cape.record.surfaces.textures import plain
from cape.record.worn import OTHER_COLORS
from cape.results.take import Take
from motions import quaternions
from motions.errors import ValueRangeError
from skeleton import Capsule, Skeleton
from tests.support.takes import take_of

FPS = 60.0


# The cut of a skirt


def lengths(cloth: cape.Cloth, chain: np.ndarray) -> np.ndarray:
    return np.linalg.norm(np.diff(cloth.positions[chain], axis=0), axis=1)


@given(st.floats(0.6, 1.5), st.floats(0.3, 1.0), st.floats(0.7, 2.0), st.floats(0.03, 0.06))
def test_a_skirt_has_its_measures(waist, length, flare, spacing):
    skirt = cape.Cloth.skirt(waist=waist, length=length, flare=flare, spacing=spacing)
    around, rings = len(skirt.region("waist")), skirt.vertices // len(skirt.region("waist"))
    for region, girth in (("waist", waist), ("hem", flare * waist)):
        ring = skirt.region(region)
        assert lengths(skirt, np.append(ring, ring[0])) == pytest.approx(girth / around, rel=1e-9)
    index = np.arange(skirt.vertices).reshape(rings, around)
    for column in index.T:
        assert lengths(skirt, column) == pytest.approx(length / (rings - 1), rel=1e-9)
    # Between neighbouring threads from waist to hem lies a trapezoid.
    top, bottom = waist / around, flare * waist / around
    panel = (top + bottom) / 2.0 * math.sqrt(length**2 - ((bottom - top) / 2.0) ** 2)
    assert isinstance(skirt, cape.MeshCloth)
    assert areas(skirt.corners).sum() == pytest.approx(around * panel, rel=1e-9)
    assert skirt.masses().sum() == pytest.approx(around * panel * skirt.fabric.density, rel=1e-9)


def test_a_skirt_is_closed_and_faces_outwards():
    skirt = cape.Cloth.skirt(waist=0.9, length=0.5, flare=1.4)
    edges = edges_of(skirt.triangles)
    border = edges.vertices[edges.triangles == 1]
    assert set(border.ravel()) == {*skirt.region("waist"), *skirt.region("hem")}
    assert len(border) == 2 * len(skirt.region("waist"))
    corners = skirt.positions[skirt.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    assert (np.einsum("ti,ti->t", normals[:, :2], corners.mean(axis=1)[:, :2]) > 0.0).all()


def test_a_skirt_is_painted_folded_flat():
    skirt = cape.Cloth.skirt(waist=0.9, length=0.5, flare=1.4)
    # As long as the skirt, and half of the hem wide but for half a cell where an odd number has no vertex at the back.
    around = len(skirt.region("waist"))
    assert np.ptp(skirt.pattern, axis=0) == pytest.approx([0.63 * (1.0 - around % 2 / around), 0.5], rel=1e-9)
    assert skirt.texcoords.min() == 0.0
    assert skirt.texcoords.max() == 1.0


@pytest.mark.parametrize(
    ("measures", "text"),
    [
        ({"waist": 0.0}, "waist must be positive"),
        ({"flare": -1.0}, "flare must be positive"),
        ({"length": 0.05}, "too wide for a skirt"),
        ({"waist": 0.9, "length": 0.5, "flare": 5.0}, "less than 4.4[0-9] lies flat"),
    ],
)
def test_what_is_no_skirt_is_refused(measures, text):
    with pytest.raises(ValueRangeError, match=text):
        cape.Cloth.skirt(**measures)


# Where cloth starts


def test_a_moved_cloth_is_the_same_elsewhere():
    sheet = cape.Cloth.rectangle(width=0.4, height=0.2, spacing=0.1)
    turn = quaternions.from_euler(np.array([0.3, -0.5, 1.1]), "xyz")
    moved = sheet.moved([1.0, 2.0, 3.0], turn)
    expected = np.array([1.0, 2.0, 3.0]) + sheet.positions @ quaternions.to_matrix(turn).T
    np.testing.assert_allclose(moved.positions, expected, atol=1e-12)
    assert isinstance(moved, cape.GridCloth)
    assert np.array_equal(moved.pattern, sheet.pattern)


def test_what_no_cloth_can_be_moved_by_is_refused():
    sheet = cape.Cloth.rectangle(width=0.4, height=0.2, spacing=0.1)
    with pytest.raises(ValueRangeError, match="3 finite numbers"):
        sheet.moved([0.0, np.nan, 0.0])
    with pytest.raises(ValueRangeError, match="unit length"):
        sheet.moved([0.0, 0.0, 0.0], [1.0, 1.0, 0.0, 0.0])
    with pytest.raises(ValueRangeError, match="wearer"):
        cape.Cloth.cape().moved([0.0, 0.0, 1.0])


def test_a_banner_hangs_where_it_was_laid_on_its_bone():
    laid = cape.Cloth.rectangle(width=0.3, height=0.4, spacing=0.1, origin=(0.1, 0.05, 0.0), right=(1.0, 0.0, 0.0))

    def hand(frame: int) -> tuple[np.ndarray, np.ndarray]:
        turn = quaternions.from_euler(np.array([0.7, 0.02 * frame]), "zy")
        return np.array([0.3, -0.2, 1.4 + 0.005 * frame]), turn

    banner = laid.moved(*hand(0))
    simulation = cape.Simulation(cape.Scene(banner, [cape.attach(banner, "hand", "top")]))
    top = banner.region("top")
    simulation.start({"hand": hand(0)})
    np.testing.assert_allclose(simulation.positions, banner.positions, atol=1e-6)
    for frame in range(1, 6):
        simulation.step({"hand": hand(frame)}, 1 / FPS)
    position, turn = hand(5)
    # Single precision, within a metre of its own origin.
    expected = position + quaternions.rotate(turn, laid.positions[top])
    np.testing.assert_allclose(simulation.positions[top], expected, atol=1e-6)
    assert np.abs(simulation.positions - banner.positions).max() > 0.01


def test_a_skirt_stays_on_a_walker():
    clip = motions.load("walk")
    body = Skeleton.from_clip(clip)
    track = body.track(clip)
    skirt = cape.Cloth.skirt(waist=1.25, length=0.6, flare=1.6)
    skirt = skirt.moved(track.positions[0, track.index("pelvis")] + [0.0, 0.0, 0.05])
    legs = body.capsules(
        only=["pelvis", *(f"{side}_{limb}" for side in ("left", "right") for limb in ("thigh", "shin"))]
    )
    scene = cape.Scene(skirt, [cape.attach(skirt, "pelvis", "waist")], legs, wind=cape.Wind())
    take = cape.simulate(scene, track)
    assert take.result == "finished"
    assert np.isfinite(take.positions).all()
    assert take.penetration.max() <= 0.002
    # Cloth of 2,000 N/m that knees push before them: 3 %; with borders that hold nothing it is 25 %.
    assert take.stretch_max.max() <= 0.1
    # It is worn: its hem is around both legs, below the thighs' middle.
    hem = take.positions[-1, skirt.region("hem")]
    for side in ("left", "right"):
        knee = track.positions[-1, track.index(f"{side}_shin")]
        assert hem[:, 0].min() < knee[0] < hem[:, 0].max()
        assert hem[:, 1].min() < knee[1] < hem[:, 1].max()


# Several cloths in one recording


def worn(name: str, shift: float, frames: int = 6, **changes) -> Take:
    """A triangle that moves, a metre by a `shift` in front of a bone."""
    places = np.tile(np.eye(3), (frames, 1, 1)) + shift + 0.1 * np.arange(frames)[:, None, None]
    path = np.array([0.0, 0.0, 1.0]) + np.arange(frames)[:, None] * [0.0, 0.01, 0.0]
    poses: dict[str, tuple[ArrayLike, ArrayLike]] = {"Hips": (path, np.tile([1.0, 0.0, 0.0, 0.0], (frames, 1)))}
    ball = Capsule("ball", "Hips", np.zeros(3), np.zeros(3), 0.1)
    own = Capsule(f"own of {name}", "Hips", np.ones(3), np.ones(3), 0.1)
    take = take_of(places, [[0, 1, 2]], [ball, own], poses=poses)
    return replace(take, name=name, stretch_max=shift + np.arange(frames) / 100.0, **changes)


class Read:
    """A recording read back."""

    def __init__(self, path: Path) -> None:
        self.chunks = list(rr.chunk.RrdReader(path).stream())
        self.entities = {chunk.entity_path for chunk in self.chunks if not chunk.entity_path.startswith("/__")}

    def rows(self, entity: str, component: str, *, static: bool = False) -> list:
        batches = [c.to_record_batch() for c in self.chunks if c.entity_path == entity and c.is_static == static]
        return [row.as_py() for batch in batches if component in batch.schema.names for row in batch.column(component)]


def test_cloths_of_one_character_share_a_recording(tmp_path):
    takes = [
        worn("cape", 1.0, left_out={"ball": "far", "own of cape": "far"}),
        worn("skirt", 2.0, frames=4, left_out={"own of skirt": "far"}),
    ]
    record.save(takes, tmp_path / "both.rrd")
    both = Read(tmp_path / "both.rrd")
    assert "/world/cape" not in both.entities
    for take, color in zip(takes, (LOOKS["cape"].color, OTHER_COLORS[0]), strict=True):
        path = f"/world/cloths/{take.name}"
        # As many frames as the shorter take has.
        np.testing.assert_array_equal(np.array(both.rows(path, "Mesh3D:vertex_positions")), take.positions[:4])
        (texture,) = both.rows(path, "Mesh3D:albedo_texture_buffer", static=True)
        assert bytes(texture[0]) == plain(color).tobytes()
        stretch = np.array(both.rows(f"/plots/stretch/{take.name}", "Scalars:scalars")).ravel()
        np.testing.assert_allclose(stretch, 100.0 * take.stretch_max[:4])
    (labels,) = both.rows("/world/hitboxes", "Capsules3D:labels", static=True)
    # What one of them reaches is not left out; what no take but one knows is that one's.
    assert labels == ["ball", "own of cape (left out)", "own of skirt (left out)"]


def test_a_single_take_in_a_list_is_recorded_as_ever(tmp_path):
    record.save([worn("cape", 1.0)], tmp_path / "one.rrd")
    assert {"/world/cape", "/plots/stretch"} <= Read(tmp_path / "one.rrd").entities


def test_takes_that_do_not_belong_together_are_refused(tmp_path):
    target = tmp_path / "no.rrd"
    with pytest.raises(ValueRangeError, match="no take"):
        record.save([], target)
    with pytest.raises(ValueRangeError, match="different names; given twice: cape"):
        record.save([worn("cape", 1.0), worn("cape", 2.0)], target)
    other = worn("skirt", 2.0)
    moved = replace(other.bones, positions=other.bones.positions + 0.001)
    with pytest.raises(ValueRangeError, match="'cape' and 'skirt' are of different motions"):
        record.save([worn("cape", 1.0), replace(other, bones=moved)], target)
    assert not target.exists()


# Bones of another simulator


def test_the_bodies_of_mujoco_need_no_pinocchio(tmp_path):
    example = (Path(__file__).parents[1] / "examples" / "mujoco_bodies.py").read_text()
    ending = """
import sys
position, turn = bodies()["forearm"]
held = position + quaternions.rotate(turn, laid.positions[laid.region("top")])
off = abs(simulation.positions[laid.region("top")] - held).max()
print("pinocchio" in sys.modules, position[2], off)
"""
    example = example.replace("banner = banner.moved(", "laid = banner\nbanner = banner.moved(")
    done = subprocess.run([sys.executable, "-c", example + ending], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    loaded, height, off = done.stdout.split("\n")[-2].split()
    assert loaded == "False"
    # The arm has swung down, and carries the banner where it was laid on it, in single precision.
    assert float(height) < 1.4
    assert float(off) < 1e-6
