"""The Pinocchio model of the body that a clip moves, made once somebody asks for it."""

# Pinocchio lies in a folder that only a .pth file puts on the path, where pyright doesn't look.
# pyright: reportMissingImports=false

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from motions.clip import Clip
from motions.errors import require_package

if TYPE_CHECKING:
    import pinocchio

FloatArray = NDArray[np.float64]

_STILL = 1e-12
"""Joint positions that vary by less [m] are constant: rounding, far below the 1e-9 m that poses are good for."""


@dataclass(frozen=True, eq=False)
class ClipModel:
    """What a model is made of.

    Attributes:
        name: of the model.
        joints: names of the J joints, parents first.
        parents: index of each joint's parent, -1 for the root, shape (J,).
        offsets: position of each joint in its parent's frame [m], NaN where it varies, shape (J, 3).
        end_parents: joint at which each of the E end sites hangs, shape (E,).
        end_offsets: position of each end site in its joint's frame [m], shape (E, 3).
    """

    name: str
    joints: tuple[str, ...]
    parents: NDArray[np.int64]
    offsets: FloatArray
    end_parents: NDArray[np.int64]
    end_offsets: FloatArray

    @staticmethod
    def of(clip: Clip) -> "ClipModel":
        """That of a clip's body."""
        offsets = constant_offsets(clip)
        return ClipModel(clip.name, clip.joints, clip.parents, offsets, clip.end_parents, clip.end_offsets)

    @property
    def free(self) -> NDArray[np.bool_]:
        """Which joints may change their place, shape (J,): the root, and those that do."""
        return (self.parents < 0) | np.isnan(self.offsets).any(axis=1)

    def build(self) -> "pinocchio.Model":
        """A free-flying joint for the root and for joints that change place, ball joints for the others.

        Raises:
            UserError: Pinocchio isn't installed.
        """
        require_package("pinocchio", "the model of a body")
        import pinocchio as pin

        model = pin.Model()
        model.name = self.name
        for joint, (name, parent, free) in enumerate(zip(self.joints, self.parents.tolist(), self.free, strict=True)):
            kind = pin.JointModelFreeFlyer() if free else pin.JointModelSpherical()
            placement = pin.SE3.Identity() if free else pin.SE3(np.eye(3), self.offsets[joint])
            model.addJoint(parent + 1, kind, placement, name)
        for number, (joint, offset) in enumerate(zip(self.end_parents.tolist(), self.end_offsets, strict=True)):
            end = pin.Frame(f"{self.joints[joint]} end {number}", joint + 1, pin.SE3(np.eye(3), offset), pin.OP_FRAME)
            model.addFrame(end)
        return model


def constant_offsets(clip: Clip) -> FloatArray:
    """Position of each joint in its parent's frame [m], shape (J, 3); NaN for a joint whose position varies."""
    if clip.local_positions is None:
        return clip.offsets
    varies = np.ptp(clip.local_positions, axis=0).max(axis=1) > _STILL
    return np.where(varies[:, None], np.nan, clip.local_positions[0])
