"""What runs in Blender's Python: the add-on is installed, capes are hung on armatures, and what is there then is told.

    python in_blender.py ADDON CLIP.bvh FOLDER
    blender --background --python in_blender.py -- ADDON CLIP.bvh FOLDER

Writes FOLDER/told.json, and a picture FOLDER/drawn.png.
"""

# pyright: reportMissingImports=false

import builtins
import json
import sys
from pathlib import Path

import bpy
from mathutils import Vector

FRAMES = (3, 9, 14)
COARSE = "--spacing 0.08 --no-self-contact"


def places(armature, cloth) -> dict[str, dict[str, list]]:
    """Heads of all bones and vertices of the cloth in the world, at some frames."""
    found = {}
    for frame in FRAMES:
        bpy.context.scene.frame_set(frame)
        shown = cloth.evaluated_get(bpy.context.evaluated_depsgraph_get())
        heads = {bone.name: list(armature.matrix_world @ bone.head) for bone in armature.pose.bones}
        vertices = [list(shown.matrix_world @ vertex.co) for vertex in shown.to_mesh().vertices]
        found[str(frame)] = {"heads": heads, "vertices": vertices}
    return found


def hang(armature, folder: Path, **settings: str) -> dict:
    """Hang a cape on an armature and tell what is there."""
    scene = bpy.context.scene
    scene.cape.folder, scene.cape.options = str(folder), COARSE
    for name, value in settings.items():
        setattr(scene.cape, name, value)
    bpy.context.view_layer.objects.active = armature
    try:
        bpy.ops.object.cape_hang()
    except RuntimeError as error:
        return {"error": str(error)}
    cloth = bpy.data.objects[f"{armature.name} cape"]
    images = [n.image.size[0] for m in cloth.data.materials for n in m.node_tree.nodes if n.type == "TEX_IMAGE"]
    return {"places": places(armature, cloth), "images": images, "first": cloth.modifiers["Cape"].frame_start}


def two_roots():
    """An armature of two bones without parents, one of which grows away from the other."""
    data = bpy.data.armatures.new("pair")
    pair = bpy.data.objects.new("pair", data)
    bpy.context.scene.collection.objects.link(pair)
    bpy.context.view_layer.objects.active = pair
    bpy.ops.object.mode_set(mode="EDIT")
    for side in (-1.0, 1.0):
        bone = data.edit_bones.new(f"a {side:+.0f}")
        bone.head, bone.tail = (side, 0.0, 1.0), (side, 0.5, 1.0)
    bpy.ops.object.mode_set(mode="POSE")
    moving = pair.pose.bones[1]
    for frame, shift in ((1, 0.0), (5, 0.2)):
        moving.location = (0.0, shift, 0.0)
        moving.keyframe_insert("location", frame=frame)
    bpy.ops.object.mode_set(mode="OBJECT")
    return pair


def draw(armature, path: Path) -> None:
    """A small picture of the cape, from behind and the left."""
    scene = bpy.context.scene
    scene.frame_set(FRAMES[-1])
    middle = armature.matrix_world @ armature.pose.bones[0].head
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.location = middle + Vector((2.0, 2.0, 0.8))
    camera.rotation_euler = (middle - camera.location).to_track_quat("-Z", "Y").to_euler()
    sun = bpy.data.objects.new("sun", bpy.data.lights.new("sun", "SUN"))
    for each in (camera, sun):
        scene.collection.objects.link(each)
    sun.data.energy, scene.camera = 4.0, camera
    scene.render.engine, scene.cycles.samples, scene.cycles.use_denoising = "CYCLES", 4, False
    scene.render.resolution_x = scene.render.resolution_y = 160
    scene.render.filepath = str(path)
    bpy.ops.render.render(write_still=True)


def main(addon: Path, clip: Path, folder: Path) -> None:
    """Do all of it."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.preferences.addon_install(filepath=str(addon), overwrite=True)
    bpy.ops.preferences.addon_enable(module=addon.stem)
    scene = bpy.context.scene
    scene.use_preview_range, scene.frame_preview_start, scene.frame_preview_end = True, 3, 14

    bpy.ops.import_anim.bvh(filepath=str(clip), update_scene_fps=True)
    walker = bpy.context.object
    for bone in walker.data.bones:
        bone.name = f"mixamorig:{bone.name}"
    walker.scale, walker.rotation_euler, walker.location = (0.01,) * 3, (0.0, 0.0, 0.7), (1.0, 2.0, 0.0)
    told: dict = {"turned": hang(walker, folder / "turned"), "unknown": hang(walker, folder / "bad", garment="toga")}
    draw(walker, folder / "drawn.png")
    walker.rotation_euler, walker.location = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0)
    bpy.ops.object.select_all(action="DESELECT")
    walker.select_set(True)
    bpy.ops.export_scene.fbx(
        filepath=str(folder / "walk.fbx"), use_selection=True, add_leaf_bones=False, bake_anim_simplify_factor=0.0
    )
    bpy.ops.import_scene.fbx(filepath=str(folder / "walk.fbx"))
    told["fbx"] = hang(bpy.context.object, folder / "fbx", garment="shoulder_cape")

    module = sys.modules[addon.stem]
    joints = module.sampled_joints(scene, two_roots(), range(1, 6))
    (folder / "pair.bvh").write_text(module.bvh_text(joints, 30.0))
    told["range"] = list(module.frames_of(scene, walker))
    scene.use_preview_range = False
    told["ranges"] = [len(module.frames_of(scene, walker)), len(module.frames_of(scene, bpy.data.objects["pair"]))]
    (folder / "told.json").write_text(json.dumps(told))


if __name__ == "__main__":
    # Debian's 3.4 reads BVH in a mode that its own Python has no more.
    plainly = builtins.open
    builtins.open = lambda file, mode="r", *more, **options: plainly(file, mode.replace("U", ""), *more, **options)
    main(*map(Path, sys.argv[-3:]))
