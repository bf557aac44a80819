"""What all prims of a USD export need: samples over time, names, and materials."""

# Its modules are compiled, and tell pyright little.
# pyright: reportAttributeAccessIssue=false, reportMissingModuleSource=false

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from pxr import Usd


def sample(attribute: Any, values: Iterable[Any], codes: Sequence[float]) -> None:
    """Set the values of an attribute at all time codes."""
    for value, code in zip(values, codes, strict=True):
        attribute.Set(value, code)


def identifiers(names: Iterable[str]) -> list[str]:
    """Names as USD takes them, each once."""
    from pxr import Tf

    found: dict[str, None] = {}
    for name in names:
        valid = base = Tf.MakeValidIdentifier(name or "_")
        number = 1
        while valid in found:
            number += 1
            valid = f"{base}_{number}"
        found[valid] = None
    return list(found)


def material(
    stage: Usd.Stage,
    path: str,
    bound: str,
    *,
    picture: str | None,
    colour: Sequence[float] = (1.0, 1.0, 1.0, 1.0),
    rough: float = 1.0,
) -> None:
    """Make a material of a picture beside the file, multiplied by a colour and its opacity, and bind it to a mesh.

    Args:
        stage: where.
        path: of the material.
        bound: path of the mesh, whose texture coordinates are called `st`.
        picture: name of the file; None for the colour alone.
        colour: of light, and opacity, 0 to 1 each.
        rough: roughness, 0 to 1.
    """
    from pxr import Gf, Sdf, UsdShade

    made, types = UsdShade.Material.Define(stage, path), Sdf.ValueTypeNames
    surface = UsdShade.Shader.Define(stage, f"{path}/surface")
    surface.CreateIdAttr("UsdPreviewSurface")
    surface.CreateInput("roughness", types.Float).Set(rough)
    surface.CreateInput("metallic", types.Float).Set(0.0)
    diffuse = surface.CreateInput("diffuseColor", types.Color3f)
    if picture is None:
        diffuse.Set(Gf.Vec3f(*colour[:3]))
    else:
        texture, reader = (UsdShade.Shader.Define(stage, f"{path}/{name}") for name in ("albedo", "st"))
        reader.CreateIdAttr("UsdPrimvarReader_float2")
        reader.CreateInput("varname", types.String).Set("st")
        texture.CreateIdAttr("UsdUVTexture")
        texture.CreateInput("file", types.Asset).Set(Sdf.AssetPath(f"./{picture}"))
        texture.CreateInput("sourceColorSpace", types.Token).Set("sRGB")
        texture.CreateInput("st", types.Float2).ConnectToSource(reader.CreateOutput("result", types.Float2))
        if tuple(colour[:3]) != (1.0, 1.0, 1.0):
            texture.CreateInput("scale", types.Float4).Set(Gf.Vec4f(*colour[:3], 1.0))
        diffuse.ConnectToSource(texture.CreateOutput("rgb", types.Float3))
    if colour[3] < 1.0:
        surface.CreateInput("opacity", types.Float).Set(colour[3])
    made.CreateSurfaceOutput().ConnectToSource(surface.CreateOutput("surface", types.Token))
    UsdShade.MaterialBindingAPI.Apply(stage.GetPrimAtPath(bound)).Bind(made)
