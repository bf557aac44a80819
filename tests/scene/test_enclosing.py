"""Balls around colliders: no collider that is near is ever left out, and most that are far are."""

import numpy as np
import pytest

import cape
from cape.scene.enclosing import Enclosing
from cape.scene.poses import Pose
from motions import quaternions
from skeleton import Capsule
from skeleton.solid_measures import signed_distance

BONES = ("hand", "foe")


def field(rng: np.random.Generator, count: int) -> list[cape.Collider]:
    """Colliders of all kinds, on both bones and in the world, up to 3 m off."""
    colliders: list[cape.Collider] = []
    for k in range(count):
        name, bone = f"c{k}", (*BONES, None)[k % 3]
        place, axis, size = rng.uniform(-3.0, 3.0, 3), rng.standard_normal(3), rng.uniform(0.02, 0.3)
        turn = quaternions.normalize(rng.standard_normal(4))
        sizes = rng.uniform(0.02, 0.3, 3)
        colliders.append(
            [
                Capsule(name, bone, place, place + axis, size),
                cape.TaperedCapsule(
                    name=name, bone=bone, start=place, end=place + axis, start_radius=size, end_radius=0.3 * size
                ),
                cape.Sphere(name=name, bone=bone, center=place, radius=size),
                cape.Box(name=name, bone=bone, center=place, half_sizes=sizes, rotation_wxyz=turn),
                cape.Cylinder(name=name, bone=bone, start=place, end=place + axis, radius=size),
                cape.Ellipsoid(name=name, bone=bone, center=place, radii=sizes, rotation_wxyz=turn),
                cape.Plane(name=name, bone=bone, point=place, normal=axis),
            ][k // 3 % 7]
        )
    return colliders


@pytest.mark.parametrize("seed", range(10))
def test_none_that_is_near_is_left_out_and_few_that_are_not_are_kept(seed):
    rng = np.random.default_rng(seed)
    colliders = field(rng, 210)
    pose = Pose(
        np.concatenate([rng.uniform(-1.0, 1.0, (2, 3)), np.zeros((1, 3))]),
        np.concatenate([quaternions.normalize(rng.standard_normal((2, 4))), [[1.0, 0.0, 0.0, 0.0]]]),
    )
    points, within = rng.uniform(-0.3, 0.3, (40, 3)) + rng.uniform(-1.0, 1.0, 3), 0.1
    kept = set(Enclosing.of(colliders, BONES).near(pose, points, within).tolist())
    for c, collider in enumerate(colliders):
        bone = 2 if collider.bone is None else BONES.index(collider.bone)
        own = quaternions.rotate(quaternions.conjugate(pose.rotations_wxyz[bone]), points - pose.positions[bone])
        distance = signed_distance(collider, own).min()
        assert c in kept or distance > within
        # Around the points, and around a solid as long as these, balls add up to so much.
        assert c not in kept or isinstance(collider, cape.Plane) or distance < within + 4.0
    assert len(kept) < 150


def test_a_ball_is_as_large_as_it_must_be():
    ball = cape.Sphere(name="ball", bone=None, center=np.array([1.0, 2.0, 3.0]), radius=0.25)
    box = cape.Box(name="box", bone="hand", center=np.zeros(3), half_sizes=np.array([0.2, 0.3, 0.6]))
    found = Enclosing.of([ball, box, cape.Plane(name="floor")], ("hand",))
    np.testing.assert_allclose(found.centers[:2], [[1.0, 2.0, 3.0], [0.0, 0.0, 0.0]], atol=1e-12)
    np.testing.assert_allclose(found.radii, [0.25, 0.7, np.inf], atol=5e-9)
    assert found.bones.tolist() == [1, 0, 1]


def test_what_is_not_finite_is_near_everything():
    colliders = field(np.random.default_rng(0), 6)
    pose = Pose(np.zeros((3, 3)), np.tile([1.0, 0.0, 0.0, 0.0], (3, 1)))
    assert len(Enclosing.of(colliders, BONES).near(pose, np.full((1, 3), np.nan), 0.1)) == 6
