"""Hitboxes as Pinocchio's own collision geometry, for whoever plans or simulates with Pinocchio."""

# Pinocchio and coal lie in a folder that only a .pth file puts on the path, where pyright doesn't look.
# pyright: reportMissingImports=false

from collections.abc import Iterable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.errors import UnknownNameError, ValueRangeError
from skeleton.model import Skeleton
from skeleton.robot.hitboxes import Hitboxes
from skeleton.shapes import Bounded, Box, Sphere, TaperedCapsule

if TYPE_CHECKING:
    import pinocchio

FloatArray = NDArray[np.float64]


def add_to_geometry_model(
    hitboxes: Hitboxes | Iterable[Bounded],
    body: Skeleton,
    geometry_model: "pinocchio.GeometryModel | None" = None,
) -> "pinocchio.GeometryModel":
    """Add solids to a geometry model of a body's Pinocchio model, each under its name.

    Capsules become `coal.Capsule` (axis along z, centred), spheres `coal.Sphere`, boxes `coal.Box`. Coal has no tapered
    capsule: it becomes a `coal.Convex` that holds it and is nowhere farther out than 0.5 % of the larger radius. No
    pairs are added; for all of them call `addAllCollisionPairs` on the result.

    Args:
        hitboxes: the solids, in the frames of the body's bones.
        body: whose bones carry them.
        geometry_model: what to add to, changed in place; a new one by default.

    Returns:
        The geometry model.

    Raises:
        UnknownNameError: a solid's bone isn't one of the body's; lists the bones.
        ValueRangeError: the geometry model has something of a solid's name.
    """
    import pinocchio as pin

    added = pin.GeometryModel() if geometry_model is None else geometry_model
    solids = tuple(hitboxes.solids if isinstance(hitboxes, Hitboxes) else hitboxes)
    for solid in solids:
        if solid.bone is not None and solid.bone not in body.bones:
            raise UnknownNameError(f"bone for the hitbox {solid.name!r}", solid.bone, body.bones)
        if added.existGeometryName(solid.name):
            raise ValueRangeError(f"the geometry model has an object named {solid.name!r} already")
    for solid in solids:
        joint = 0 if solid.bone is None else body.bones.index(solid.bone) + 1
        geometry, rotation_wxyz, center = _geometry(solid)
        placement = pin.SE3(quaternions.to_matrix(rotation_wxyz), center)
        added.addGeometryObject(pin.GeometryObject(solid.name, joint, placement, geometry))
    return added


def _geometry(solid: Bounded) -> tuple[Any, FloatArray, FloatArray]:
    """Coal's geometry, its unit quaternion geometry_to_bone (w, x, y, z), and its place in the bone's frame [m]."""
    import coal

    upright = np.array([1.0, 0.0, 0.0, 0.0])
    if isinstance(solid, Sphere):
        return coal.Sphere(float(solid.radius)), upright, solid.center
    if isinstance(solid, Box):
        return coal.Box(*(2.0 * solid.half_sizes).tolist()), solid.rotation_wxyz, solid.center
    if isinstance(solid, TaperedCapsule):
        return _convex(solid), upright, solid.start
    axis = solid.end - solid.start
    length = float(np.linalg.norm(axis))
    if not length > 0.0:
        return coal.Sphere(float(solid.radius)), upright, solid.start
    return coal.Capsule(float(solid.radius), length), quaternions.from_z_axis(axis), (solid.start + solid.end) / 2.0


def _convex(solid: TaperedCapsule) -> Any:
    """A polyhedron around a tapered capsule, seen from its start: the hull of polyhedra around both of its spheres."""
    import coal
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=3)
    # Every face of this polyhedron is at least as far out as the unit sphere.
    around = ball.vertices / np.einsum("ij,ij->i", ball.face_normals, ball.triangles_center).min()
    ends = (solid.start_radius * around, solid.end - solid.start + solid.end_radius * around)
    hull = trimesh.convex.convex_hull(np.concatenate(ends))
    corners, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    for corner in hull.vertices:
        corners.append(np.array(corner))
    for first, second, third in hull.faces.tolist():
        faces.append(coal.Triangle(first, second, third))
    return coal.Convex(corners, faces)
