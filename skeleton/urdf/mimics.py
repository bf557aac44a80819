"""Joints of a robot that follow others, as gears and fingers do: `<mimic joint multiplier offset>` of a URDF file."""

# Pinocchio lies in a folder that only a .pth file puts on the path, where pyright doesn't look.
# pyright: reportMissingImports=false

import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from motions.errors import FileError
from motions.files import printable

if TYPE_CHECKING:
    import pinocchio

FloatArray = NDArray[np.float64]


@dataclass(frozen=True)
class Mimic:
    """A joint that is where another one is, times a factor and shifted.

    Attributes:
        joint: its name.
        source: the joint that it follows, which follows none.
        multiplier: of the source's position.
        offset: added to that [rad] or [m].
    """

    joint: str
    source: str
    multiplier: float
    offset: float


def read_mimics(robot: ElementTree.Element, model: "pinocchio.Model") -> tuple[tuple[Mimic, ...], tuple[str, ...]]:
    """The joints of a model that follow others, and a sentence on what can't be followed.

    Args:
        robot: the file's root element.
        model: made of the file, so that its numbers are known to be sound.

    Raises:
        FileError: joints follow each other in a circle.
    """
    names, joints = set(model.names), {joint.get("name", ""): joint for joint in robot.iter("joint")}
    found, lost = [], []
    for name, joint in joints.items():
        if name not in names or joint.find("mimic") is None or not _has_one_axis(model, name):
            continue
        source, multiplier, offset, passed = name, 1.0, 0.0, set()
        while source in joints and (tag := joints[source].find("mimic")) is not None:
            if source in passed:
                raise FileError(f"the joint {printable(name)} mimics itself, by way of others")
            passed.add(source)
            offset += multiplier * float(tag.get("offset", 0.0))
            multiplier *= float(tag.get("multiplier", 1.0))
            source = tag.get("joint", "")
        if source in names and _has_one_axis(model, source):
            found.append(Mimic(name, source, multiplier, offset))
        elif source in joints:  # fixed, so at zero
            found.append(Mimic(name, name, 0.0, offset))
        else:
            lost.append(f"the joint {printable(name)} mimics {printable(source)!r}, which is none: it moves by itself")
    return tuple(found), tuple(lost)


def followed(configurations: FloatArray, mimics: tuple[Mimic, ...], model: "pinocchio.Model") -> FloatArray:
    """Configurations (..., nq) in which joints that follow others are where these take them."""
    if not mimics:
        return configurations
    configurations = np.array(configurations)
    for mimic in mimics:
        value = mimic.multiplier * _position(configurations, model, mimic.source) + mimic.offset
        start, size = _place(model, mimic.joint)
        if size == 1:
            configurations[..., start] = value
        else:
            configurations[..., start], configurations[..., start + 1] = np.cos(value), np.sin(value)
    return configurations


def _position(configurations: FloatArray, model: "pinocchio.Model", joint: str) -> FloatArray:
    """Of a joint of one axis [rad] or [m]; one that turns without end is stored as cosine and sine."""
    start, size = _place(model, joint)
    if size == 1:
        return configurations[..., start]
    return np.arctan2(configurations[..., start + 1], configurations[..., start])


def _place(model: "pinocchio.Model", joint: str) -> tuple[int, int]:
    """Where a joint's numbers begin in a configuration, and how many there are."""
    number = model.getJointId(joint)
    return int(model.idx_qs[number]), int(model.nqs[number])


def _has_one_axis(model: "pinocchio.Model", joint: str) -> bool:
    return int(model.nvs[model.getJointId(joint)]) == 1
