"""What is read off a running cloth: contacts and penetration, against distances of their own from the take alone."""

from dataclasses import replace

import numpy as np
import pytest

import cape
from cape.kernels.cloth.measure import NEAR
from cape.measure import meter
from cape.results.penetration import penetration, signed_distance
from cape.results.take import Take
from motions import quaternions
from skeleton import BoneTrack, Capsule
from tests.support.scenes import mesh_cloth

FAR = np.array([300.0, -200.0, 50.0])  # m, of the scene's origin: a run refers to a place nearby
ROUNDING = 4e-5  # m: a unit in the last place of single precision at 300 m, and its rounding twice


def out(x: float, y: float, z: float) -> np.ndarray:
    """A place in the world [m], by where it is from the scene's origin."""
    return FAR + np.array([x, y, z])


@pytest.fixture(scope="module", params=["grid", "mesh"])
def take(request) -> Take:
    """A sheet held along one edge that falls onto a ball, a tapered log that turns, a box and a plane, far out."""
    u, v = np.linspace(0.0, 0.8, 17), np.linspace(0.0, 0.8, 17)
    where = {"right": (0.0, 1.0, 0.0), "down": (1.0, 0.0, 0.0), "origin": out(0.0, -0.4, 1.0)}
    if request.param == "mesh":
        cloth: cape.Cloth = mesh_cloth(u, v, cape.Fabric(), **where)
    else:
        cloth = cape.Cloth.rectangle(width=0.8, height=0.8, spacing=0.05, **where)
    frames = 25
    angle = np.linspace(0.0, 0.8, frames)
    zero = np.zeros(frames)
    rotations = np.stack(
        [
            np.tile([1.0, 0.0, 0.0, 0.0], (frames, 1)),
            np.stack([np.cos(angle / 2), zero, zero, np.sin(angle / 2)], axis=1),
        ],
        axis=1,
    )
    track = BoneTrack(("rod", "wheel"), np.arange(frames) / 60.0, np.tile(FAR, (frames, 2, 1)), rotations)
    colliders = [
        cape.Plane(name="table", point=out(0.0, 0.0, 0.72)),
        cape.Sphere(name="ball", bone="rod", center=np.array([0.3, -0.2, 0.8]), radius=0.15),
        cape.TaperedCapsule(
            name="log",
            bone="wheel",
            start=np.array([0.4, 0.1, 0.8]),
            end=np.array([0.7, 0.2, 0.8]),
            start_radius=0.14,
            end_radius=0.08,
            thickness=0.02,
        ),
        cape.Box(name="box", bone="rod", center=np.array([0.65, -0.25, 0.8]), half_sizes=np.array([0.1, 0.1, 0.1])),
        Capsule("stick", None, out(0.1, 0.0, 0.9), out(0.1, 0.3, 0.9), 0.05),
    ]
    held = [cape.attach(cloth, "rod", [16 * 17 + k for k in range(17)] if request.param == "mesh" else "top")]
    return cape.simulate(cape.Scene(cloth, held, colliders), track)


def distances(take: Take, frame: int, collider: cape.Collider) -> np.ndarray:
    """Of all vertices from a collider [m], shape (V,)."""
    points = take.positions[frame].astype(float)
    if collider.bone is not None:
        bone = take.bones.index(collider.bone)
        turn = quaternions.to_matrix(take.bones.rotations_wxyz[frame, bone])
        points = (points - take.bones.positions[frame, bone]) @ turn
    return signed_distance(collider, points)


def test_contacts_are_all_free_vertices_in_a_thickness(take):
    contacts = take.contacts
    assert contacts is not None
    free = np.ones(take.positions.shape[1], dtype=bool)
    free[take.held] = False
    assert len(take.held) == 17
    assert len(set(contacts.colliders.tolist())) >= 4
    for frame in range(len(take.positions)):
        rows = slice(contacts.starts[frame], contacts.starts[frame + 1])
        for index, collider in enumerate(take.colliders):
            beyond = distances(take, frame, collider) - take.thicknesses[index] - NEAR
            found = set(contacts.vertices[rows][contacts.colliders[rows] == index].tolist())
            assert found >= set(np.flatnonzero(free & (beyond < -ROUNDING)).tolist())
            assert found <= set(np.flatnonzero(free & (beyond < ROUNDING)).tolist())


def test_a_contact_leads_from_the_surface_to_its_vertex(take):
    contacts = take.contacts
    assert contacts is not None
    frames = contacts.frames
    np.testing.assert_allclose(np.linalg.norm(contacts.normals, axis=1), 1.0, atol=1e-6)
    distance = take.thicknesses[contacts.colliders] - contacts.depths
    reached = contacts.points + distance[:, None] * contacts.normals
    np.testing.assert_allclose(reached, take.positions[frames, contacts.vertices], atol=2 * ROUNDING)
    on_surface = replace(take, positions=take.positions.copy())
    for row in range(len(frames)):
        on_surface.positions[frames[row], 0] = contacts.points[row]
        off = distances(on_surface, frames[row], take.colliders[contacts.colliders[row]])[0]
        assert abs(off) < 2 * ROUNDING


def test_penetration_is_the_deepest_of_all_contacts(take):
    free = np.ones(take.positions.shape[1], dtype=bool)
    free[take.held] = False
    found = penetration(take, counted=free).vertices
    np.testing.assert_allclose(take.penetration, found.depth, atol=ROUNDING)


def test_room_for_contacts_grows(monkeypatch):
    sizes = []
    made = meter._ContactRoom.__init__

    def note(room: meter._ContactRoom, size: int) -> None:
        sizes.append(size)
        made(room, size)

    monkeypatch.setattr(meter._ContactRoom, "__init__", note)
    monkeypatch.setattr(meter, "ROOM", 1)
    track = BoneTrack(("rod",), np.arange(3) / 60.0, np.zeros((3, 1, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (3, 1, 1)))
    cloth = cape.Cloth.rectangle(width=0.4, height=0.4, spacing=0.1, origin=(0.0, 0.0, 0.0), down=(1.0, 0.0, 0.0))
    # In the plane's thickness from the first frame on.
    scene = cape.Scene(cloth, [cape.attach(cloth, "rod", "top")], [cape.Plane(point=np.array([0.0, 0.0, -0.001]))])
    again = cape.simulate(scene, track)
    assert again.contacts is not None
    assert again.contacts.counts.tolist() == [20, 20, 20]
    assert again.contacts.vertices.tolist() == 3 * list(range(5, 25))
    assert sizes[-2:] == [1, 40]
