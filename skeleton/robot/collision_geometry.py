"""Hitboxes as Pinocchio's own collision geometry, for whoever plans or simulates with Pinocchio."""

# Pinocchio lies in a folder that only a .pth file puts on the path, where pyright doesn't look.
# pyright: reportMissingImports=false

from collections.abc import Iterable
from typing import TYPE_CHECKING

from motions import quaternions
from motions.border import checked
from motions.errors import UnknownNameError, ValueRangeError
from skeleton.model import Skeleton
from skeleton.robot.hitboxes import Hitboxes
from skeleton.shapes import Shape, require_known

if TYPE_CHECKING:
    import pinocchio


@checked
def add_to_geometry_model(
    hitboxes: Hitboxes | Iterable[Shape],
    body: Skeleton,
    geometry_model: "pinocchio.GeometryModel | None" = None,
) -> "pinocchio.GeometryModel":
    """Add solids to a geometry model of a body's Pinocchio model, each under its name.

    Capsules become `coal.Capsule` (axis along z, centred), spheres `coal.Sphere`, boxes `coal.Box`, cylinders
    `coal.Cylinder`, ellipsoids `coal.Ellipsoid`, planes `coal.Halfspace`. Coal has no tapered capsule: it becomes a
    `coal.Convex` that holds it and is nowhere farther out than 0.5 % of the larger radius. No pairs are added; for all
    of them call `addAllCollisionPairs` on the result.

    Args:
        hitboxes: the solids, in the frames of the body's bones.
        body: whose bones carry them.
        geometry_model: what to add to, changed in place; a new one by default.

    Returns:
        The geometry model.

    Raises:
        UnknownNameError: a solid's bone isn't one of the body's, or its shape is unknown; lists what there is.
        ValueRangeError: the geometry model has something of a solid's name.
    """
    import pinocchio as pin

    added = pin.GeometryModel() if geometry_model is None else geometry_model
    solids = tuple(hitboxes.solids if isinstance(hitboxes, Hitboxes) else hitboxes)
    require_known(solids)
    for solid in solids:
        if solid.bone is not None and solid.bone not in body.bones:
            raise UnknownNameError(f"bone for the hitbox {solid.name!r}", solid.bone, body.bones)
        if added.existGeometryName(solid.name):
            raise ValueRangeError(f"the geometry model has an object named {solid.name!r} already")
    for solid in solids:
        geometry, rotation_wxyz, center = solid.collision_geometry()
        joint, placement = 0, pin.SE3(quaternions.to_matrix(rotation_wxyz), center)
        if solid.bone is not None:
            bone = body.bones.index(solid.bone)
            joint = int(body.carriers.joints[bone])
            placement = pin.SE3(body.carriers.rotations[bone], body.carriers.positions[bone]) * placement
        added.addGeometryObject(pin.GeometryObject(solid.name, joint, placement, geometry))
    return added
