"""What runs in Blender's Python: a file is opened, and its vertices are told at some frames.

    python in_blender.py FILE MESH FPS FRAMES FOLDER

Writes FOLDER/told.json, vertices of the mesh in the world by frame, and a picture FOLDER/drawn.png of it in the last
frame, with the cloth.
"""

# pyright: reportMissingImports=false

import json
import sys
from pathlib import Path

import bpy
from mathutils import Vector

SIZE = 96  # pixels


def opened(path: Path, name: str):
    """The mesh object of a file whose name begins so."""
    if path.suffix == ".glb":
        bpy.ops.import_scene.gltf(filepath=str(path), merge_vertices=False)
    elif path.suffix == ".usd":
        bpy.ops.wm.usd_import(filepath=str(path), set_frame_range=False)
    else:
        bpy.ops.wm.obj_import(filepath=str(path.with_suffix(".obj")))
    mesh = next(o for o in bpy.data.objects if o.type == "MESH" and o.name.startswith(name))
    if path.suffix in (".pc2", ".mdd"):
        cache = mesh.modifiers.new("cache", "MESH_CACHE")
        cache.cache_format, cache.filepath = path.suffix[1:].upper(), str(path)
        cache.frame_start, cache.forward_axis, cache.up_axis = 0.0, "POS_Y", "POS_Z"
    return mesh


def draw(mesh, path: Path) -> None:
    """A picture of that mesh and those in its scene that are drawn with it, but for solids."""
    scene = bpy.context.scene
    for each in bpy.data.objects:
        each.hide_render = each.type != "MESH" or (each is not mesh and not each.name.startswith("cape"))
    shown = mesh.evaluated_get(bpy.context.evaluated_depsgraph_get())
    corners = [shown.matrix_world @ Vector(corner) for corner in shown.bound_box]
    middle = sum(corners, Vector()) / 8.0
    away = max(1.0, 2.4 * max((corner - middle).length for corner in corners))
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.location = middle + away * Vector((0.6, -0.9, 0.6))
    camera.rotation_euler = (middle - camera.location).to_track_quat("-Z", "Y").to_euler()
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    sun.data.energy, sun.rotation_euler, scene.camera = 5.0, camera.rotation_euler, camera
    for each in (camera, sun):
        scene.collection.objects.link(each)
    scene.render.engine, scene.cycles.samples, scene.render.film_transparent = "CYCLES", 2, True
    scene.render.resolution_x = scene.render.resolution_y = SIZE
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)


def main(path: Path, name: str, fps: float, frames: int, folder: Path) -> None:
    """Open, look and tell."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.fps = round(fps)
    mesh, told = opened(path, name), []
    for frame in range(frames):
        scene.frame_set(frame)
        shown = mesh.evaluated_get(bpy.context.evaluated_depsgraph_get())
        told.append([list(shown.matrix_world @ vertex.co) for vertex in shown.to_mesh().vertices])
    (folder / "told.json").write_text(json.dumps(told))
    draw(mesh, folder / "drawn.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2], float(sys.argv[3]), int(sys.argv[4]), Path(sys.argv[5]))
