"""Whatever is given for an argument of what is public: it is taken, or refused by a UserError, and nothing else."""

import math
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import cape
import motions
import skeleton
from motions.border import checked, fits
from motions.errors import UserError, ValueRangeError

SHEET = cape.Cloth.rectangle(width=0.4, height=0.4, spacing=0.2)
UNTURNED = [1.0, 0.0, 0.0, 0.0]
POSE = {"rod": (np.zeros(3), UNTURNED)}
TRACK = {
    "names": ("rod",),
    "times": np.arange(3) / 60,
    "positions": np.zeros((3, 1, 3)),
    "rotations_wxyz": np.tile(UNTURNED, (3, 1, 1)),
    "parents": None,
    "roles": {},
}
BONES = skeleton.BoneTrack(**TRACK)
SCENE = cape.Scene(SHEET, [cape.attach(SHEET, "rod", "top")])
CLIP = motions.load("idle").trim(0.0, 0.1)
BODY = skeleton.Skeleton.from_clip(CLIP)
MOVING = BODY.track(CLIP)
SOLID = {"name": "solid", "bone": None, "friction": 0.1, "thickness": 0.01}
ENDS = {"start": np.zeros(3), "end": np.ones(3)}
ITERATED = {"tolerance": 1e-7, "iterations": 4, "forcing": 0.1, "linear_iterations": 5}
STEPS = {"substeps": 2, "precision": "double"}


def started() -> cape.Simulation:
    simulation = cape.Simulation(SCENE)
    simulation.start(POSE, settle=0.0)
    return simulation


RUNNING = started()

# What is called, and arguments that are right, but for files that are not there.
RIGHT: dict[str, tuple[Callable[..., Any], dict[str, Any]]] = {
    "Attachment": (
        cape.Attachment,
        {"bone": "rod", "vertices": np.arange(3), "points": np.zeros((3, 3)), "within": None, "others": (),
         "weights": None, "stiffness": None, "damping": None, "along": None},
    ),
    "Auto": (cape.Auto, {"tolerance": 1e-3}),
    "Auto by time": (cape.Auto, {"budget": 1e-3}),
    "AutoSimulation": (
        cape.AutoSimulation, {"scene": SCENE, "asked": cape.Auto(tolerance=1e-3), "threads": 1, "cuts": None},
    ),
    "BackwardEuler": (cape.BackwardEuler, STEPS | ITERATED),
    "Batch": (cape.Batch, {"simulations": [RUNNING], "threads": 1}),
    "BoneTrack": (skeleton.BoneTrack, TRACK),
    "BoneTrack.at": (BONES.at, {"frame": 1}),
    "BoneTrack.first": (BONES.first, {"frames": 2}),
    "BoneTrack.part": (BONES.part, {"first": 1, "end": 2}),
    "BoneTrack.resample": (BONES.resample, {"fps": 30.0}),
    "BoneTrack.sample": (BONES.sample, {"t": 0.01}),
    "BoneTrack.select": (BONES.select, {"bones": ["rod"]}),
    "Box": (cape.Box, SOLID | {"center": np.zeros(3), "half_sizes": np.ones(3), "rotation_wxyz": UNTURNED}),
    "Capsule": (cape.Capsule, SOLID | ENDS | {"radius": 0.1}),
    "Clip": (motions.Clip, {name: getattr(CLIP, name) for name in CLIP.__dataclass_fields__}),
    "Clip.trim": (CLIP.trim, {"start": 0.0, "end": 0.1}),
    "Cloth.cape": (cape.Cloth.cape, {"length": 0.4, "spacing": 0.2}),
    "Cloth.from_mesh": (cape.Cloth.from_mesh, {"positions": np.eye(3), "triangles": [[0, 1, 2]]}),
    "Cloth.load": (cape.Cloth.load, {"path": "/nowhere.obj"}),
    "Cloth.moved": (SHEET.moved, {"position": [0.0, 0.0, 1.0], "rotation_wxyz": UNTURNED}),
    "Cloth.rectangle": (
        cape.Cloth.rectangle,
        {"width": 0.4, "height": 0.4, "spacing": 0.2, "origin": (0.0, 0.0, 0.0), "right": (0.0, 1.0, 0.0),
         "down": (0.0, 0.0, -1.0), "fabric": None},
    ),
    "Cuts": (cape.Cuts, {"speed": 1.0, "spin": 1.0, "then": "carry"}),
    "Cylinder": (cape.Cylinder, SOLID | ENDS | {"radius": 0.1}),
    "Ellipsoid": (cape.Ellipsoid, SOLID | {"center": np.zeros(3), "radii": np.ones(3), "rotation_wxyz": UNTURNED}),
    "Fabric": (
        cape.Fabric,
        {"density": 0.2, "stretch": 100.0, "shear": 10.0, "bend": 1e-5, "damping_time": 1e-5,
         "bend_damping_time": 1e-3, "strain_limit": 0.1},
    ),
    "MotionGraph": (motions.MotionGraph, {"clips": [CLIP, CLIP], "blend": 0.03, "longest": 0.05, "search": 0.01}),
    "Plane": (cape.Plane, SOLID | {"point": np.zeros(3), "normal": [0.0, 0.0, 1.0]}),
    "RobotMotion": (skeleton.RobotMotion, {"name": "x", "configurations": np.zeros((3, 7)), "times": np.arange(3.0)}),
    "Scene": (
        cape.Scene,
        {"cloth": SHEET, "attachments": SCENE.attachments, "colliders": (), "gravity": (0.0, 0.0, -9.81),
         "wind": cape.Wind(), "friction": 0.3, "thickness": 0.01, "self_contact": None, "strain_limit": True,
         "tearing": None, "tethers": None, "confinements": ()},
    ),
    "Live": (
        cape.Live,
        {"scene": SCENE, "source": BONES, "name": "live", "fps": 60.0, "solver": cape.XPBD(), "threads": 1,
         "viewer": "none", "bind": "127.0.0.1", "keep": False, "end_with_viewer": True, "surfaces": (),
         "on_frame": None},
    ),
    "SelfContact": (cape.SelfContact, {"thickness": 0.01, "friction": 0.1}),
    "Simulation": (
        cape.Simulation, {"scene": SCENE, "solver": cape.XPBD(), "threads": 1, "cuts": None, "ledger": None},
    ),
    "Simulation.disturb": (RUNNING.disturb, {"offsets": np.zeros((9, 3))}),
    "Simulation.start": (
        cape.Simulation(SCENE).start,
        {"bones": POSE, "settle": 0.0, "velocity": (0.0, 0.0, 0.0), "spin": (0.0, 0.0, 0.0)},
    ),
    "Simulation.step": (RUNNING.step, {"bones": POSE, "dt": 1 / 60}),
    "Skeleton.from_clip": (skeleton.Skeleton.from_clip, {"clip": CLIP}),
    "Skeleton.from_urdf": (skeleton.Skeleton.from_urdf, {"path_or_name": "/nowhere.urdf", "floating_base": True}),
    "Skeleton.track": (BODY.track, {"motion": CLIP}),
    "Sphere": (cape.Sphere, SOLID | {"center": np.zeros(3), "radius": 0.1}),
    "Step": (motions.Step, {"clip": "idle", "seconds": 1.0}),
    "SymplecticEuler": (cape.SymplecticEuler, STEPS | {"margin": 0.9}),
    "TRBDF2": (cape.TRBDF2, STEPS | ITERATED),
    "Take.load": (cape.Take.load, {"path": "/nowhere.npz"}),
    "TaperedCapsule": (cape.TaperedCapsule, SOLID | ENDS | {"start_radius": 0.1, "end_radius": 0.2}),
    "Tearing": (cape.Tearing, {"strain": 0.1, "force": 10.0}),
    "Tethers": (cape.Tethers, {"slack": 0.02}),
    "Textures": (
        cape.Textures, {"albedo": np.zeros((4, 4, 3), np.uint8), "normal": None, "metal_roughness": None},
    ),
    "Wind": (
        cape.Wind,
        {"velocity": (1.0, 0.0, 0.0), "density": 1.2, "drag": 1.0, "lift": 0.1, "viscous": 0.01, "gusts": 0.1,
         "turbulence": 0.1, "seed": 0, "shelter": False, "record": None, "field": None},
    ),
    "WindRecord": (cape.WindRecord, {"times": np.arange(3.0), "velocities": np.zeros((3, 3))}),
    "XPBD": (cape.XPBD, STEPS | {"iterations": 2}),
    "attach": (cape.attach, {"cloth": SHEET, "bone": "rod", "vertices": "top", "points": None, "within": None}),
    "attach by index": (cape.attach, {"cloth": SHEET, "bone": "rod", "vertices": [0, 1], "stiffness": 1.0}),
    "check_motion": (skeleton.check_motion, {"track": BONES, "solids": (), "height": 1.8}),
    "confine": (cape.confine, {"cloth": SHEET, "bone": "rod", "vertices": "top", "max_distance": 0.1}),
    "cut": (cape.cut, {"cloth": SHEET, "along": [[0.1, 0.2], [0.3, 0.2]]}),
    "dress": (
        cape.dress,
        {"body": BODY, "track": MOVING, "garment": "back_cape", "length": 0.5, "spacing": 0.2, "fabric": None,
         "wind": None, "self_contact": False, "strain_limit": True, "hold": {}, "colliders": ()},
    ),
    "fabric": (cape.fabric, {"name": "denim"}),
    "find_roles": (
        motions.find_roles, {"joints": CLIP.joints, "parents": CLIP.parents.tolist(), "overrides": None},
    ),
    "load": (motions.load, {"path": "/nowhere.bvh", "unit": "cm", "up": "y", "height": None, "rate": None}),
    "load_hitboxes": (skeleton.load_hitboxes, {"path": "/nowhere.toml", "body": BODY}),
    "parse_script": (motions.parse_script, {"text": "idle 2s"}),
    "read_cloth": (cape.read_cloth, {"path": "/nowhere.obj", "up": "z", "scale": 1.0, "spacing": 0.1}),
    "read_textures": (cape.read_textures, {"albedo": "/nowhere.png"}),
    "read_wind": (cape.read_wind, {"path": "/nowhere.csv"}),
    "simulate": (
        cape.simulate,
        {"scene": SCENE, "track": BONES, "solver": None, "threads": 1, "fps": 60.0, "settle": 0.0, "cuts": None},
    ),
    "solver": (cape.solver, {"name": "euler", "substeps": 3}),
}  # fmt: skip

WRONG: list[Any] = [
    math.nan, math.inf, -1, 0, 1e308, -1e308, 1e-30, 2.5, True, 10**40, 1j, "x", "", b"x", None, object(),
    [], [[0, 1], [2]], [math.nan] * 3, [1e308] * 3, [-1, -2, -3], ["a", "b", "c"], [1.0, 2.0, 3.0, 4.0], [9999],
    {"a": 1}, np.array([object()], dtype=object), np.array(1.0), np.zeros((0, 3)), np.ones((2, 3)),
]  # fmt: skip

# What must not be taken, of that which would do for other arguments.
REFUSED = {
    "Scene": {"wind": "x", "friction": -1, "gravity": [math.nan] * 3, "thickness": 1e308, "self_contact": "x"},
    "Attachment": {"vertices": [-1], "points": np.full((3, 3), 1e308), "weights": np.ones(3), "within": -1},
    "Cloth.rectangle": {"origin": [1e308] * 3, "width": 1e-30, "height": 1e308},
    "Cloth.moved": {"position": [1e308] * 3},
    "Box": {"name": 1, "bone": object(), "center": [1e308] * 3, "friction": 1e308},
    "Sphere": {"radius": 1e308},
    "TaperedCapsule": {"end_radius": 1e308},
    "Simulation": {"cuts": "x", "ledger": 1.0, "solver": "euler"},
    "Simulation.start": {"settle": -1},
    "XPBD": {"iterations": 2.5},
    "TRBDF2": {"iterations": math.nan, "linear_iterations": 2.5},
    "Batch": {"threads": 2.5},
    "Wind": {"density": 1e308, "shelter": "yes", "field": 1.0, "record": "mast.csv", "velocity": [1e308] * 3},
    "find_roles": {"parents": [0] * len(CLIP.joints)},
    "check_motion": {"height": -1},
    "BoneTrack.resample": {"fps": 1e12},
    "simulate": {"fps": 1e-30, "solver": "euler"},
    "dress": {"fabric": "denim", "wind": (1.0, 0.0, 0.0), "body": "walk"},
}


def failure(call: Callable[..., Any], given: dict[str, Any]) -> str | None:
    """What is wrong with how a call fails, None where nothing is, or where it does not."""
    try:
        call(**given)
    except UserError as error:
        return None if 0 < len(str(error)) < 500 else f"{len(str(error))} characters"
    except Exception as error:
        return f"{type(error).__name__}: {error}"
    return None


@pytest.mark.parametrize("name", RIGHT)
def test_nothing_but_a_user_error_comes_of_a_wrong_argument(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.chdir(tmp_path)  # where a wrong path, which is as good as any, is written to
    call, right = RIGHT[name]
    for argument in right:
        for value in [*WRONG, *([REFUSED[name][argument]] if argument in REFUSED.get(name, {}) else [])]:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                wrong = failure(call, right | {argument: value})
            assert wrong is None, f"{argument}={value!r}: {wrong}"


@pytest.mark.parametrize(("name", "argument"), [(name, each) for name, given in REFUSED.items() for each in given])
def test_what_makes_no_sense_is_refused(name: str, argument: str):
    call, right = RIGHT[name]
    with pytest.raises(UserError):
        call(**right | {argument: REFUSED[name][argument]})


def test_what_can_be_called_of_the_packages_is_tried():
    """But for what only holds results, errors, and what needs a robot."""
    tried = {name.split(".")[0].split(" ")[0] for name in RIGHT}
    public = {
        name
        for package in (motions, skeleton, cape)
        for name in package.__all__
        if callable(getattr(package, name)) and not name.endswith(("Error", "Warning"))
    }
    results = {"Balance", "Finding", "Hitboxes", "LinkSurface", "Measurement", "Poses", "Retargeted", "Transition"}
    abstract = {"Collider", "GridCloth", "MeshCloth", "Solver", "Visual"}
    robots = {
        "add_to_geometry_model", "column_names", "hitboxes_of", "kept_hitboxes_of", "link_surfaces",
        "load_configurations", "missing_meshes", "retarget",
    }  # fmt: skip
    others = {"Confinement", "Diverged", "Ledger", "Pose", "clip_names", "clip_path", "format_script", "require_role",
              "save", "wear"}  # fmt: skip
    assert public - tried == results | abstract | robots | others


# -- what tells --


@checked
def halved(length: float, *, parts: tuple[float, ...] = (), name: str | None = None) -> float:
    return (length + sum(parts)) / (2 if name is None else len(name))


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"length": "x"}, "length must be a number, not 'x'"),
        ({"length": 1.0, "parts": ("a",)}, "parts must be a sequence, each a number, not a tuple"),
        ({"length": 1.0, "name": 3.0}, "name must be a text or None, not 3.0"),
    ],
)
def test_it_is_told_which_argument_is_of_another_kind(given: dict[str, Any], told: str):
    with pytest.raises(ValueRangeError) as caught:
        halved(**given)
    assert str(caught.value) == told
    assert isinstance(caught.value.__cause__, TypeError)


@checked
def of_what_is_not_imported(model: "nowhere.Model | None", length: float) -> float:  # noqa: F821 # pyright: ignore
    return length + 1.0


def test_kinds_of_modules_that_are_imported_for_type_checkers_are_any():
    assert of_what_is_not_imported(None, 1.0) == 2.0
    with pytest.raises(ValueRangeError, match="length must be a number, not 'x'"):
        of_what_is_not_imported(None, "x")  # pyright: ignore


def test_a_fault_of_its_own_is_left_as_it_is():
    with pytest.raises(ZeroDivisionError):
        halved(1.0, name="")
    with pytest.raises(TypeError, match="unexpected keyword"):
        halved(1.0, width=2.0)  # pyright: ignore[reportCallIssue]


@pytest.mark.parametrize(
    ("value", "hint", "good"),
    [
        (1, float, True), (np.float32(1.0), float, True), (True, float, False), (1.0, int, False), (1, int, True),
        ([1, 2.0], tuple[float, ...], True), (np.ones(3), tuple[float, float, float], True),
        ([1, 2], tuple[float, float, float], False), ("ab", tuple[str, ...], False), ({}, dict[str, int], True),
        ({"a": "b"}, dict[str, int], False), ([0.5], np.ndarray[Any, np.dtype[np.int64]], False),
        ([1.0], np.ndarray[Any, np.dtype[np.int64]], True), (None, int | None, True), (len, Callable[..., int], True),
        (b"ab", bytes | None, True), ("ab", bytes | None, False),
    ],
)  # fmt: skip
def test_kinds(value: Any, hint: Any, good: bool):
    assert fits(value, hint) == good


@pytest.mark.parametrize("name", ["pattern", "positions", "faces", "corners", "rest"])
def test_a_cloth_made_of_lists_is_refused_by_their_name(name: str):
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    arrays: dict[str, Any] = {
        "pattern": corners[:, :2],
        "positions": corners,
        "faces": np.array([[0, 1, 2]]),
        "rest": corners,
    }
    arrays["corners"] = corners[None, :, :2]
    cape.MeshCloth(**arrays)
    with pytest.raises(UserError, match=f"^{name} must be an array, not a list$"):
        cape.MeshCloth(**{**arrays, name: arrays[name].tolist()})
