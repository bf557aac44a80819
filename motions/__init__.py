"""Motion clips: reading, writing, sampling, and the ones that come with the package."""

from motions.bodies.roles import ROLES, find_roles, require_role
from motions.bvh.writer import save
from motions.clip import Clip, Poses
from motions.errors import FileError, UnknownNameError, UserError, ValueRangeError
from motions.graph.motion_graph import MotionGraph, Transition
from motions.graph.script import Step, format_script, parse_script
from motions.loading import load
from motions.shipped import clip_names, clip_path

__all__ = [
    "ROLES",
    "Clip",
    "FileError",
    "MotionGraph",
    "Poses",
    "Step",
    "Transition",
    "UnknownNameError",
    "UserError",
    "ValueRangeError",
    "clip_names",
    "clip_path",
    "find_roles",
    "format_script",
    "load",
    "parse_script",
    "require_role",
    "save",
]
