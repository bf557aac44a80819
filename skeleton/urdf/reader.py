"""From a URDF file to a Pinocchio model, or to a sentence that says what the file is instead."""

# Pinocchio lies in a folder that only a .pth file puts on the path, where pyright doesn't look.
# pyright: reportMissingImports=false

import os
import re
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from motions.errors import FileError
from motions.files import printable, read_bytes
from motions.limits import LARGEST_MARKUP

if TYPE_CHECKING:
    import pinocchio

FASTEST_JOINT = "1e9"  # rad/s or m/s: the limit of a joint that tells none
_OTHERS = {"mujoco": "an MJCF file of MuJoCo", "sdf": "an SDF file of Gazebo"}


def read_urdf(path: Path) -> ElementTree.Element:
    """The root element of a URDF file.

    Raises:
        FileError: it is missing, no XML, or another format; says what to do.
    """
    content = read_bytes(path, most=LARGEST_MARKUP)
    try:
        robot = ElementTree.fromstring(content)
        is_xacro = any("xacro" in element.tag for element in robot.iter())
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        if b"<xacro:" not in content:
            raise FileError(f"{path} can't be read as URDF: {error}") from None
        robot, is_xacro = None, True
    if is_xacro or robot is None or path.suffix.lower() == ".xacro":
        made = path.name.removesuffix(".xacro").removesuffix(".urdf") + "_made.urdf"
        raise FileError(f"{path} is a xacro file, of which a URDF file is yet to be made: xacro {path} -o {made}")
    if robot.tag in _OTHERS:
        raise FileError(f"{path} is {_OTHERS[robot.tag]}, not URDF: convert it, or take the robot's URDF file")
    return robot


def complete(robot: ElementTree.Element) -> bool:
    """Fill in what exporters leave out and the parser insists on, though nothing here needs it; tell whether it was.

    That is the effort and the speed of a joint's limit, and the mass of a link that has an empty `inertial`, for which
    the parser leaves out the link's shapes as well.
    """
    completed = False
    for limit in robot.iterfind("joint/limit"):
        for name, value in (("effort", "0"), ("velocity", FASTEST_JOINT)):
            if name not in limit.attrib:
                limit.set(name, value)
                completed = True
    for link in robot.iterfind("link"):
        for inertial in link.findall("inertial"):
            if inertial.find("mass") is None or inertial.find("inertia") is None:
                link.remove(inertial)
                completed = True
    return completed


def model_of_urdf(path: Path, *, floating_base: bool) -> "pinocchio.Model":
    """The model of a robot, with a joint in front that moves freely where one is wanted and missing.

    Raises:
        FileError: Pinocchio can't read the file, or nothing moves in it.
    """
    import pinocchio as pin

    robot = read_urdf(path)
    text = ElementTree.tostring(robot, encoding="unicode") if complete(robot) else None

    def build(*root: "pinocchio.JointModelFreeFlyer") -> "pinocchio.Model":
        return pin.buildModelFromUrdf(str(path), *root) if text is None else pin.buildModelFromXML(text, *root)

    with _said_by_the_parser() as said:
        try:
            model = build()
            floats = [joint.shortname() for joint in model.joints.tolist()[1:2]] == ["JointModelFreeFlyer"]
            if floating_base and not floats:
                model = build(pin.JointModelFreeFlyer())
            _ = model.name, tuple(model.names), [frame.name for frame in model.frames]  # are they texts?
        except (ValueError, RuntimeError) as error:
            problem = said() or " ".join(str(error).split())
            raise FileError(f"{path} can't be read as URDF: {printable(problem)}") from None
    if model.njoints < 2:
        raise FileError(f"{path} has no joint that moves")
    return model


@contextmanager
def _said_by_the_parser() -> Iterator[Callable[[], str]]:
    """Give what asks for the first error that the URDF parser wrote in the block to where errors go, without place.

    It writes to the file behind standard error, past Python's own `sys.stderr`.
    """
    with tempfile.TemporaryFile() as taken:

        def said() -> str:
            taken.seek(0)
            found = re.search(r"Error:\s+(.*)", taken.read().decode(errors="replace"))
            return found[1].strip() if found else ""

        try:
            usual = os.dup(2)
        except OSError:  # there is no standard error
            yield lambda: ""
            return
        try:
            os.dup2(taken.fileno(), 2)
            yield said
        finally:
            os.dup2(usual, 2)
            os.close(usual)
