# SPDX-License-Identifier: MIT
"""Hang a simulated cape on a selected armature.

This file is a Blender add-on on its own: install it by Edit > Preferences > Add-ons > Install. It writes the
motion of the armature as BVH, calls the command `cape`, which need not be in Blender's Python, and brings the cloth
back as a mesh that a point cache moves. The panel is in the sidebar (N) of the 3D viewport, tab Cape.
"""

# ruff: noqa: RUF012, SIM115 (classes are as Blender reads them; files stay open while the command runs)
# Blender's own types are made at run time: properties stand where annotations do.
# pyright: reportMissingImports=false, reportInvalidTypeForm=false, reportAttributeAccessIssue=false

import functools
import json
import math
import re
import shlex
import shutil
import subprocess
import tempfile
import time
from pathlib import Path

import bpy

bl_info = {
    "name": "Cape",
    "author": "the authors of cape",
    "version": (0, 1, 0),
    "blender": (3, 4, 0),
    "location": "3D viewport > Sidebar > Cape",
    "description": "Hang a simulated cape on the selected armature",
    "category": "Animation",
}

COMMAND = "cape"
MODULE = __name__
MOVED = 1e-5  # [m]: a joint that moves further in the frame of its parent gets channels for its position
POLL = 0.2  # [s] between looks at the running command
PATIENCE = 3600.0  # [s] for it, where Blender has no window in which to stop it


class CapeError(Exception):
    """What went wrong, in a line for the user."""


# --- the armature's motion as BVH ---------------------------------------------------------------------------------


class Joint:
    """A bone as BVH has it: all joints' axes are the world's in the rest pose.

    `parent` is a Joint or None, `offset` from the parent's head to its own and `tip` from its head to its tail [m].
    """

    def __init__(self, name, parent, offset, tip):
        """A joint that has no frames yet."""
        self.name, self.parent, self.offset, self.tip = name, parent, offset, tip
        self.children = []
        self.rotations = []  # of each frame, Euler angles of the order Z, X, Y [rad]
        self.places = []  # of each frame, from the parent's head in its axes [m]
        if parent is not None:
            parent.children.append(self)

    @property
    def moves(self):
        """Whether its position needs channels."""
        return self.parent is None or any((place - self.offset).length > MOVED for place in self.places)


def frames_of(scene, armature):
    """The frames to simulate: the preview's range where there is one, else the action's, else the scene's."""
    if scene.use_preview_range:
        return range(scene.frame_preview_start, scene.frame_preview_end + 1)
    animation = armature.animation_data
    if animation is not None and animation.action is not None:
        first, last = animation.action.frame_range
        return range(math.floor(first), math.ceil(last) + 1)
    return range(scene.frame_start, scene.frame_end + 1)


def sampled_joints(scene, armature, frames):
    """The armature's bones over some frames, in the world, as Joints, parents first.

    Only bones that deform count, unless there are none; a rig of several roots gets one above them.
    """
    from mathutils import Vector

    bones = [bone for bone in armature.data.bones if bone.use_deform] or list(armature.data.bones)
    if not bones:
        raise CapeError(f"{armature.name} has no bones")
    chosen = {bone.name for bone in bones}
    metres = scene.unit_settings.scale_length
    scene.frame_set(frames[0])
    world = armature.matrix_world.copy()
    above, heads, turns, joints = {}, {}, {}, {}
    for bone in armature.data.bones:
        if bone.name not in chosen:
            continue
        parent = bone.parent
        while parent is not None and parent.name not in chosen:
            parent = parent.parent
        above[bone.name] = None if parent is None else parent.name
        rest = world @ bone.matrix_local
        heads[bone.name] = rest.translation.copy()
        turns[bone.name] = rest.to_quaternion().inverted()
    roots = [name for name, parent in above.items() if parent is None]
    origin = Joint("armature", None, Vector((0.0, 0.0, 0.0)), None) if len(roots) > 1 else None
    taken = {"armature"}
    for name, parent in above.items():
        over = origin if parent is None else joints[parent]
        start = heads[parent] if parent is not None else Vector((0.0, 0.0, 0.0))
        tip = world @ armature.data.bones[name].tail_local - heads[name]
        joints[name] = Joint(_free(name, taken), over, (heads[name] - start) * metres, tip * metres)
    for frame in frames:
        scene.frame_set(frame)
        _sample(armature, above, turns, joints, metres)
        if origin is not None:
            origin.rotations.append((0.0, 0.0, 0.0))
            origin.places.append(Vector((0.0, 0.0, 0.0)))
    return [*([] if origin is None else [origin]), *joints.values()]


def _sample(armature, above, turns, joints, metres):
    """Take the pose of the present frame."""
    from mathutils import Quaternion, Vector

    still, nowhere = Quaternion(), Vector((0.0, 0.0, 0.0))
    turned, placed = {}, {}
    for name, parent in above.items():
        pose = armature.matrix_world @ armature.pose.bones[name].matrix
        turned[name] = pose.to_quaternion() @ turns[name]
        placed[name] = pose.translation.copy()
        back = turned.get(parent, still).inverted()
        euler = (back @ turned[name]).to_euler("YXZ")  # the matrix is Z @ X @ Y
        joints[name].rotations.append((euler.z, euler.x, euler.y))
        joints[name].places.append((back @ (placed[name] - placed.get(parent, nowhere))) * metres)


def _free(name, taken):
    """A joint's name that BVH can hold and that no other joint has."""
    plain = re.sub(r"[\s{}]+", "_", name) or "bone"
    free, number = plain, 1
    while free in taken:
        number += 1
        free = f"{plain}_{number}"
    taken.add(free)
    return free


def bvh_text(joints, fps):
    """The joints' motion as BVH, Z up and in metres."""
    order, lines = [], ["HIERARCHY"]

    def write(joint, indent):
        order.append(joint)
        pad = "  " * indent
        lines.append(f"{pad}{'ROOT' if joint.parent is None else 'JOINT'} {joint.name}")
        lines.append(f"{pad}{{")
        lines.append(f"{pad}  OFFSET {_numbers(joint.offset)}")
        place = "6 Xposition Yposition Zposition" if joint.moves else "3"
        lines.append(f"{pad}  CHANNELS {place} Zrotation Xrotation Yrotation")
        for child in joint.children:
            write(child, indent + 1)
        if not joint.children:
            tip = joint.tip or (0.0, 0.0, 0.0)
            lines.extend([f"{pad}  End Site", f"{pad}  {{", f"{pad}    OFFSET {_numbers(tip)}", f"{pad}  }}"])
        lines.append(f"{pad}}}")

    write(joints[0], 0)
    moving = [joint.moves for joint in order]
    frames = len(joints[0].rotations)
    lines.extend(["MOTION", f"Frames: {frames}", f"Frame Time: {1.0 / fps:.10f}"])
    for frame in range(frames):
        row = []
        for joint, moves in zip(order, moving, strict=True):
            if moves:
                row.append(_numbers(joint.places[frame]))
            row.append(_numbers(math.degrees(angle) for angle in joint.rotations[frame]))
        lines.append(" ".join(row))
    return "\n".join(lines) + "\n"


def _numbers(values):
    return " ".join(f"{value:.8f}" for value in values)


# --- the command --------------------------------------------------------------------------------------------------


def command():
    """The command `cape`, as the preferences name it."""
    known = bpy.context.preferences.addons.get(MODULE)
    asked = known.preferences.command if known is not None and known.preferences is not None else COMMAND
    found = shutil.which(bpy.path.abspath(asked) if asked.startswith("//") else asked)
    if found is None:
        raise CapeError(f"there is no command {asked!r}: name it in the preferences of the add-on Cape")
    return found


@functools.cache
def known_names(kind):
    """Names that `cape garments` or `cape fabrics` lists; none where it can't be called."""
    try:
        done = subprocess.run([command(), kind, "--json"], capture_output=True, text=True, timeout=60, check=True)
        return tuple(json.loads(done.stdout))
    except (CapeError, OSError, ValueError, subprocess.SubprocessError):
        return ()


class Run:
    """A running `cape replay`, and the files that go in and come out."""

    def __init__(self, scene, armature, settings):
        """Write the motion and begin; raises `CapeError`, and `ValueError` for options with an open quote."""
        self.fps = scene.render.fps / scene.render.fps_base
        self.name, self.frames, program = armature.name, frames_of(scene, armature), command()
        if len(self.frames) < 2:
            raise CapeError("a motion needs two frames at least: give the armature an action, or the scene an end")
        asked = bpy.path.abspath(settings.folder) if settings.folder else ""
        stem = re.sub(r"[^\w.-]+", "_", armature.name) or "armature"
        try:
            self.folder = Path(asked) if asked else Path(tempfile.mkdtemp(prefix="cape-"))
            self.folder.mkdir(parents=True, exist_ok=True)
            clip, self.cache = self.folder / f"{stem}.bvh", self.folder / f"{stem}_cape.pc2"
            now = scene.frame_current
            try:
                text = bvh_text(sampled_joints(scene, armature, self.frames), self.fps)
            finally:
                scene.frame_set(now)
            clip.write_text(text, encoding="utf-8")
            self._said = (self.folder / f"{stem}_cape.txt").open("w+", encoding="utf-8", errors="replace")
        except OSError as error:
            raise CapeError(f"can't write to {asked or 'a temporary folder'}: {error.strerror}") from error
        options = ["--unit=m", "--up=z", f"--fps={self.fps:.9g}", f"--garment={settings.garment}"]
        options += [f"--fabric={settings.fabric}", *shlex.split(settings.options)]
        self._printed = tempfile.TemporaryFile("w+", encoding="utf-8")
        self._process = subprocess.Popen(
            [program, "replay", *options, "-o", str(self.cache), "--json", "--", str(clip)],
            stdin=subprocess.DEVNULL,
            stdout=self._printed,
            stderr=self._said,
        )

    @property
    def done(self):
        """Whether it has ended."""
        return self._process.poll() is not None

    def wait(self):
        """Wait until it has ended."""
        self._process.wait(PATIENCE)

    def stop(self):
        """End it."""
        self._process.kill()
        self._process.wait()

    def facts(self):
        """What it tells of the run; raises `CapeError` with its last line where it failed."""
        self._said.seek(0)
        self._printed.seek(0)
        said, printed = self._said.read().strip(), self._printed.read().strip()
        self._said.close()
        self._printed.close()
        if self._process.returncode != 0:
            raise CapeError(said.splitlines()[-1] if said else f"cape ended with status {self._process.returncode}")
        return json.loads(printed.splitlines()[-1])


# --- the cloth in Blender -----------------------------------------------------------------------------------------


def bring(scene, run, facts):
    """Make the object of the cloth, with its material and its point cache, in place of one of an earlier run."""
    name = f"{run.name} cape"
    old = bpy.data.objects.get(name)
    if old is not None and old.modifiers.get("Cape") is not None:
        bpy.data.objects.remove(old)
    before = set(bpy.data.objects)
    options = {"forward_axis": "NEGATIVE_Z", "up_axis": "Y", "use_split_objects": False}
    known = bpy.ops.wm.obj_import.get_rna_type().properties.keys()  # before 4.0 not all
    bpy.ops.wm.obj_import(
        filepath=str(run.cache.with_suffix(".obj")), **{name: options[name] for name in options if name in known}
    )
    made = [each for each in bpy.data.objects if each not in before]
    if len(made) != 1:
        raise CapeError(f"{run.cache.with_suffix('.obj')} can't be imported")
    cloth = made[0]
    cloth.name = name
    scale = 1.0 / scene.unit_settings.scale_length
    cloth.scale = (scale, scale, scale)
    cloth.data.polygons.foreach_set("use_smooth", [True] * len(cloth.data.polygons))
    cache = cloth.modifiers.new("Cape", "MESH_CACHE")
    cache.cache_format, cache.filepath = "PC2", str(run.cache)
    # A first frame that is a pose of its own, which no motion leads out of, is left out of the run.
    cache.frame_start = run.frames[-1] + 1 - facts["frames"]
    cache.forward_axis, cache.up_axis = "POS_Y", "POS_Z"  # as the vertices are: the object turns them
    return cloth


class CAPE_OT_hang(bpy.types.Operator):
    """Simulate a cape on the selected armature, over the frames of its action or of the preview"""

    bl_idname = "object.cape_hang"
    bl_label = "Hang a cape"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context):
        """Whether an armature is selected."""
        return context.object is not None and context.object.type == "ARMATURE"

    def execute(self, context):
        """Run to the end, as scripts want it."""
        try:
            run = Run(context.scene, context.object, context.scene.cape)
            run.wait()
            return self._bring(context, run)
        except (CapeError, subprocess.TimeoutExpired, ValueError, OSError, RuntimeError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}

    def invoke(self, context, event):
        """Begin to run, while Blender goes on."""
        try:
            self._run = Run(context.scene, context.object, context.scene.cape)
        except (CapeError, ValueError, OSError) as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        self._begun = time.monotonic()
        self._timer = context.window_manager.event_timer_add(POLL, window=context.window)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        """Look whether it has ended; Escape ends it."""
        if event.type == "ESC":
            self._run.stop()
            self._end(context)
            return {"CANCELLED"}
        if event.type != "TIMER":
            return {"PASS_THROUGH"}
        if not self._run.done:
            seconds = time.monotonic() - self._begun
            context.workspace.status_text_set(f"Cape: simulating for {seconds:.0f} s, Escape stops it")
            return {"PASS_THROUGH"}
        self._end(context)
        try:
            return self._bring(context, self._run)
        except (CapeError, ValueError, OSError, RuntimeError) as error:  # the last is what Blender's own commands raise
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}

    def _end(self, context):
        context.window_manager.event_timer_remove(self._timer)
        context.workspace.status_text_set(None)

    def _bring(self, context, run):
        facts = run.facts()
        cloth = bring(context.scene, run, facts)
        for warning in facts["warnings"]:
            self.report({"WARNING"}, warning)
        self.report({"INFO"}, f"{cloth.name}: {facts['result']}, {facts['frames']} frames, files in {run.folder}")
        return {"FINISHED"}


class CapeSettings(bpy.types.PropertyGroup):
    """What is worn, and how."""

    garment: bpy.props.StringProperty(
        name="Garment",
        description="What is worn, as cape garments lists it",
        default="shoulder_cape",
        search=lambda self, context, text: known_names("garments"),
        search_options={"SORT", "SUGGESTION"},
    )
    fabric: bpy.props.StringProperty(
        name="Fabric",
        description="What it is made of, as cape fabrics lists it",
        default="cape",
        search=lambda self, context, text: known_names("fabrics"),
        search_options={"SORT", "SUGGESTION"},
    )
    options: bpy.props.StringProperty(
        name="Options", description="Further options of cape replay, such as --wind -3 0 0 --spacing 0.02"
    )
    folder: bpy.props.StringProperty(
        name="Folder",
        description="For the files that move the cloth: a new temporary one if empty",
        subtype="DIR_PATH",
    )


class CAPE_PT_panel(bpy.types.Panel):
    """The panel in the sidebar"""

    bl_label = "Cape"
    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Cape"

    def draw(self, context):
        """Show the settings and the button."""
        for name in ("garment", "fabric", "options", "folder"):
            self.layout.prop(context.scene.cape, name)
        self.layout.operator(CAPE_OT_hang.bl_idname, icon="MOD_CLOTH")


class CapePreferences(bpy.types.AddonPreferences):
    """Where the command is"""

    bl_idname = MODULE

    command: bpy.props.StringProperty(name="Command cape", default=COMMAND, subtype="FILE_PATH")

    def draw(self, context):
        """Show it."""
        self.layout.prop(self, "command")


CLASSES = (CapeSettings, CapePreferences, CAPE_OT_hang, CAPE_PT_panel)


def register():
    """Add all to Blender."""
    for each in CLASSES:
        bpy.utils.register_class(each)
    bpy.types.Scene.cape = bpy.props.PointerProperty(type=CapeSettings)


def unregister():
    """Take all out again."""
    del bpy.types.Scene.cape
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)


if __name__ == "__main__":
    register()
