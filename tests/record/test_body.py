"""The body of a clip as it is drawn, and the clasp of what it wears."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

import cape
import motions
from cape.record.figure.body import body_parts, hull_of_balls
from cape.record.figure.clasp import CORD, SAG, clasp_mesh
from motions import quaternions
from skeleton import Skeleton
from skeleton.shapes import TaperedCapsule
from skeleton.solid_measures import signed_distance
from tests.support.scenes import turn_about
from tests.support.takes import take_of

sizes = st.floats(0.02, 0.2)
places = st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array)


def volume(vertices: NDArray, triangles: NDArray) -> float:
    """What closed triangles enclose, counter-clockwise from outside, by the divergence theorem [m3]."""
    a, b, c = np.moveaxis(vertices.astype(float)[triangles], 1, 0)
    return float(np.einsum("ti,ti->", a, np.cross(b, c)) / 6.0)


@given(start=places, end=places, radii=st.tuples(sizes, sizes))
def test_a_limb_is_the_hull_of_both_its_ends(start: NDArray, end: NDArray, radii: tuple[float, float]):
    vertices, normals, triangles = hull_of_balls([(start, radii[0]), (end, radii[1])])
    exact = TaperedCapsule(name="limb", bone="arm", start=start, end=end, start_radius=radii[0], end_radius=radii[1])
    np.testing.assert_allclose(signed_distance(exact, vertices.astype(float)), 0.0, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-6)
    # Out along its normal a point gets away from the shape as fast as it moves.
    np.testing.assert_allclose(signed_distance(exact, vertices + 0.01 * normals.astype(float)), 0.01, atol=1e-6)
    # A sphere between 24 meridians and 13 parallels lacks 4 % of its volume; nothing lacks more.
    assert 0.93 * exact.volume() < volume(vertices, triangles) < exact.volume()


def test_a_body_is_within_its_capsules():
    body = Skeleton.from_clip(motions.load("walk"))
    capsules = {capsule.name: capsule for capsule in body.capsules()}
    parts = body_parts(tuple(capsules.values()))
    assert set(parts) == set(capsules) - {"left_chest", "right_chest"} | {"chest"}
    for name, (bone, balls) in parts.items():
        vertices, _, triangles = hull_of_balls(balls)
        assert bone == capsules[name].bone
        corners = vertices.astype(float)[triangles]
        # Also within its triangles: the flat front of the chest, between both halves, has no vertices.
        shares = [(1 - a, a - b, b) for a in np.linspace(0.0, 1.0, 9) for b in np.linspace(0.0, a, 5)]
        points = np.concatenate([np.tensordot(share, corners, axes=(0, 1)) for share in shares])
        of = [name] if name != "chest" else ["left_chest", "chest", "right_chest"]
        assert np.min([signed_distance(capsules[part], points) for part in of], axis=0).max() < 1e-6, name
    # A shin is thickest at the calf and thinnest at the ankle, and its ends lie on its axis.
    radii = [radius for _, radius in parts["left_shin"][1]]
    assert radii[1] == max(radii) == capsules["left_shin"].radius
    assert radii[2] == min(radii)
    np.testing.assert_array_equal(parts["left_shin"][1][2][0], capsules["left_shin"].end)


@given(length=st.floats(0.02, 0.12))
def test_a_clasp_reaches_from_edge_to_edge(length: float):
    vertices, normals, triangles = clasp_mesh(length)
    assert np.ptp(vertices[:, 0]) > length
    # It is alike on both sides, nothing of it is behind the cloth but the rims, and the cord hangs down: y points down.
    np.testing.assert_allclose(vertices[:, 0].min(), -vertices[:, 0].max(), atol=1e-6)
    assert vertices[:, 2].min() > -0.005
    assert vertices[:, 1].max() > SAG * length
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, atol=1e-5)
    assert volume(vertices, triangles) > np.pi * CORD**2 * length


def test_both_ends_of_the_collar_carry_the_clasp():
    clip = motions.load("walk").trim(0.0, 0.1)
    body = Skeleton.from_clip(clip)
    track = body.track(clip)
    cloth = cape.dress(body, track, spacing=0.08).cloth
    left, right = cloth.positions[cloth.regions["clasp"]]
    # Of the wearer's frame: x ahead, y to the left.
    assert left[1] > 0.0 > right[1]
    np.testing.assert_allclose(left[[0, 2]], right[[0, 2]], atol=1e-3)
    assert left[0] > 0.0
    assert np.linalg.norm(left - right) < 0.12
    assert "clasp" not in cape.dress(body, track, garment="half_cape", spacing=0.08).cloth.regions


def test_a_recorded_clasp_is_where_its_ends_are(tmp_path: Path):
    import rerun as rr

    clip = motions.load("walk").trim(0.0, 0.1)
    body = Skeleton.from_clip(clip)
    cloth = cape.dress(body, body.track(clip), spacing=0.08).cloth
    turns = np.array([turn_about((0.0, 0.6, 0.8), 0.4 * frame) for frame in range(3)])
    shifts = np.arange(9.0).reshape(3, 1, 3)
    places = shifts + quaternions.rotate(turns[:, None], cloth.positions[None])
    take = replace(take_of(places, cloth.triangles, []), cloth=cloth, texcoords=cloth.texcoords)
    take.save(tmp_path / "take.rrd", layers=["cape"])
    columns = {}
    for chunk in rr.chunk.RrdReader(tmp_path / "take.rrd").stream().filter(content="/world/clasp"):
        batch = chunk.to_record_batch()
        for name in set(batch.schema.names) & {"Transform3D:translation", "Transform3D:quaternion"}:
            columns[name.split(":")[1]] = np.array([row.as_py()[0] for row in batch.column(name)])
    shifted, turned = columns["translation"], np.roll(columns["quaternion"], 1, axis=1)
    ends = places[:, cloth.regions["clasp"]]
    half = np.linalg.norm(ends[0, 1] - ends[0, 0]) / 2.0
    for side, end in ((-half, ends[:, 0]), (half, ends[:, 1])):
        there = shifted + quaternions.rotate(turned, np.array([side, 0.0, 0.0]))
        np.testing.assert_allclose(there, end, atol=1e-5)
    # It turns with the cloth, away from which its z points: to the front, as worn.
    away = quaternions.rotate(quaternions.conjugate(turns), quaternions.rotate(turned, np.array([0.0, 0.0, 1.0])))
    np.testing.assert_allclose(away, away[[0, 0, 0]], atol=1e-5)
    assert away[0, 0] > 0.5
    assert quaternions.rotate(turned[0], np.array([0.0, 1.0, 0.0]))[2] < -0.5
