"""USD: the cloth with a sample of its points for each frame, its material, the skeleton, and hitboxes as guides.

Z up, in metres, both stated; a time code is a frame, and `timeCodesPerSecond` says how many make a second.

    /take                   Xform, the default prim
    /take/cape              Mesh: points, normals, texture coordinates `st`
    /take/material          UsdPreviewSurface, whose albedo is a PNG beside the file
    /take/figure/skeleton   Skeleton, and in it `motion`, a SkelAnimation
    /take/figure/PIECE      Mesh on the skeleton, of a character that has one: with blend shapes, material, albedo
    /take/hitboxes/NAME     Capsule, Cube, Sphere or Mesh, in the world, of the purpose "guide"
"""

# Its modules are compiled, and tell pyright little.
# pyright: reportAttributeAccessIssue=false, reportMissingModuleSource=false

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cape.cloth.normals import vertex_normals
from cape.exports.figure.usd import add_figure
from cape.exports.moving_mesh import MovingMesh
from cape.exports.usd_parts import identifiers, material, sample
from motions import quaternions
from motions.errors import FileError
from motions.files import whole_file
from skeleton.shapes.outlines import BoxOutline, CapsuleOutline, EllipsoidOutline, MeshOutline
from skeleton.track import BoneTrack

if TYPE_CHECKING:
    from pxr import Usd

TAKE = "/take"
FloatArray = NDArray[np.float64]


def write(mesh: MovingMesh, path: Path) -> tuple[Path, ...]:
    """Write the file, and its textures beside it; gives all.

    Raises:
        FileError: one can't be written.
    """
    from pxr import Tf, Usd, UsdGeom

    picture = mesh.write_texture(path)
    stage = Usd.Stage.CreateInMemory()
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(mesh.fps)
    stage.SetFramesPerSecond(mesh.fps)
    codes = _time_codes(mesh)
    stage.SetStartTimeCode(codes[0])
    stage.SetEndTimeCode(codes[-1])
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, TAKE).GetPrim())
    stage.GetRootLayer().comment = f"{mesh.name}, written by cape"
    _cloth(stage, mesh, codes)
    material(stage, f"{TAKE}/material", f"{TAKE}/cape", picture=picture.name, rough=mesh.look.rough)
    pictures = add_figure(stage, f"{TAKE}/figure", mesh.bones, codes, path)
    _hitboxes(stage, mesh, codes)
    with whole_file(path) as partial:
        try:
            stage.GetRootLayer().Export(str(partial))
        except Tf.ErrorException as error:
            raise FileError(f"can't write {path}: {_reason(error)}") from None
    return path, picture, *pictures


def _reason(error: Exception) -> str:
    """The first message of USD's errors, which tell the places in its sources as well."""
    quoted = re.search(r": '(.*)'$", str(error), re.MULTILINE)
    return quoted[1] if quoted else str(error)


def _time_codes(mesh: MovingMesh) -> list[float]:
    """Time of each frame in frames, whole numbers where frames are even."""
    codes = mesh.times * mesh.fps
    return np.where(np.abs(codes - np.rint(codes)) < 1e-6, np.rint(codes), codes).tolist()


def _cloth(stage: Usd.Stage, mesh: MovingMesh, codes: Sequence[float]) -> None:
    from pxr import Sdf, UsdGeom, Vt

    cloth = UsdGeom.Mesh.Define(stage, f"{TAKE}/cape")
    cloth.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    cloth.CreateDoubleSidedAttr(True)
    cloth.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(mesh.triangles), 3, np.int32)))
    cloth.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(mesh.triangles.astype(np.int32).ravel()))
    coordinates = UsdGeom.PrimvarsAPI(cloth).CreatePrimvar(
        "st", Sdf.ValueTypeNames.TexCoord2fArray, UsdGeom.Tokens.vertex
    )
    coordinates.Set(Vt.Vec2fArray.FromNumpy(np.ascontiguousarray(mesh.bottom_up)))
    cloth.SetNormalsInterpolation(UsdGeom.Tokens.vertex)
    normals = vertex_normals(mesh.positions, mesh.triangles)
    bounds = np.stack([mesh.positions.min(axis=1), mesh.positions.max(axis=1)], axis=1)
    for attribute, values in [
        (cloth.CreatePointsAttr(), mesh.positions),
        (cloth.CreateNormalsAttr(), normals),
        (cloth.CreateExtentAttr(), bounds),
    ]:
        sample(attribute, map(Vt.Vec3fArray.FromNumpy, values), codes)


def _hitboxes(stage: Usd.Stage, mesh: MovingMesh, codes: Sequence[float]) -> None:
    """Each solid by its outline, but for endless planes."""
    from pxr import UsdGeom

    UsdGeom.Scope.Define(stage, f"{TAKE}/hitboxes")
    for collider, name in zip(mesh.colliders, identifiers([c.name for c in mesh.colliders]), strict=True):
        path, outline, size = f"{TAKE}/hitboxes/{name}", collider.outline(), None
        if isinstance(outline, CapsuleOutline):
            axis = outline.end - outline.start
            solid = UsdGeom.Capsule.Define(stage, path)
            solid.CreateAxisAttr(UsdGeom.Tokens.z)
            solid.CreateHeightAttr(float(np.linalg.norm(axis)))
            solid.CreateRadiusAttr(float(outline.radius))
            place, turn = (outline.start + outline.end) / 2.0, quaternions.from_z_axis(axis)
        elif isinstance(outline, BoxOutline | EllipsoidOutline):
            if isinstance(outline, BoxOutline):
                solid = UsdGeom.Cube.Define(stage, path)
                solid.CreateSizeAttr(2.0)
            else:
                solid = UsdGeom.Sphere.Define(stage, path)
                solid.CreateRadiusAttr(1.0)
            place, turn, size = outline.center, outline.rotation_wxyz, outline.half_sizes
        elif isinstance(outline, MeshOutline):
            solid = _solid_mesh(stage, path, outline)
            place, turn = outline.origin, outline.rotation_wxyz
        else:
            continue
        solid.CreatePurposeAttr(UsdGeom.Tokens.guide)
        solid.CreateDisplayColorAttr([(0.3, 0.5, 0.9)])
        if not isinstance(outline, MeshOutline):
            solid.CreateExtentAttr(UsdGeom.Boundable.ComputeExtentFromPlugins(solid, 0.0))
        _carry(solid, mesh.bones, collider.bone, place, turn, codes)
        if size is not None:
            solid.AddScaleOp().Set(tuple(size.tolist()))


def _solid_mesh(stage: Usd.Stage, path: str, outline: MeshOutline) -> Any:
    from pxr import UsdGeom, Vt

    solid = UsdGeom.Mesh.Define(stage, path)
    solid.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    solid.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(outline.vertices))
    solid.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(len(outline.triangles), 3, np.int32)))
    solid.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(outline.triangles.astype(np.int32).ravel()))
    corners = np.stack([outline.vertices.min(axis=0), outline.vertices.max(axis=0)])
    solid.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(corners.astype(np.float32)))
    return solid


def _carry(
    solid: Any, bones: BoneTrack, bone: str | None, place: FloatArray, turn: FloatArray, codes: Sequence[float]
) -> None:
    """Move what stands in a bone's frame with it, or leave it where it stands in the world."""
    from pxr import Gf, UsdGeom

    move, rotate = solid.AddTranslateOp(), solid.AddOrientOp(UsdGeom.XformOp.PrecisionDouble)
    if bone is None:
        move.Set(Gf.Vec3d(place.tolist()))
        rotate.Set(Gf.Quatd(*turn.tolist()))
        return
    index = bones.index(bone)
    poses, turns = bones.positions[:, index], bones.rotations_wxyz[:, index]
    sample(move, map(Gf.Vec3d, (poses + quaternions.rotate(turns, place)).tolist()), codes)
    sample(rotate, (Gf.Quatd(*q) for q in quaternions.multiply(turns, turn).tolist()), codes)
