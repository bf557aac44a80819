"""Arms of a robot that are kept out of its trunk, its legs and each other, as far as where they should be allows it."""

# Pinocchio lies in a folder that only a .pth file puts on the path, where pyright doesn't look.
# pyright: reportMissingImports=false

from collections.abc import Sequence
from itertools import combinations
from typing import Any

import numpy as np
from numpy.typing import NDArray

from skeleton.checks.arms import forearm_sides
from skeleton.checks.crossings import NEAR, bones_between
from skeleton.model import Skeleton
from skeleton.robot.collision_geometry import add_to_geometry_model
from skeleton.shapes import Shape

FloatArray = NDArray[np.float64]

_COST = 12.0
"""Cost of a metre that solids are in each other."""

_YIELDS = 0.006
"""Depth of solids in each other [m] at which they are pushed apart the hardest, by Cauchy's loss (weights as in
Holland and Welsch 1977, "Robust regression using iteratively reweighted least-squares"); what is much deeper is let
be, as a robot's hips may be so much wider than an actor's that its hands belong in them."""

_NOTICED = 0.1
"""Solids closer than this [m] are not to get into each other at once."""

_INWARDS = 0.003
"""Most that a step of the solver takes solids into each other [m]: unhindered, it takes them in and out by turns."""


class Apart:
    """What keeps arms apart from the rest of a robot, as a task and as a limit of Pink's.

    As a task it pushes solids that are in each other apart; as a limit it lets them get into each other only slowly,
    until the task sees it. What should be deep in each other so comes to rest less deep.
    """

    def __init__(self, body: Skeleton, solids: Sequence[Shape], model: Any):
        """Find what can get in each other's way.

        Args:
            body: the robot.
            solids: around its bones. An arm's are those from the forearm on. Those of neighbouring bones, and of bones
                at most `skeleton.crossings.NEAR` apart that overlap where `model` is neutral, are let be.
            model: of the body, which may have more frames.

        Raises:
            UnknownNameError: a solid's bone isn't one of the body's; lists the bones.
        """
        import pinocchio as pin

        carried = [solid for solid in solids if solid.bone is not None]
        self._geometry = add_to_geometry_model(carried, body)
        arms = forearm_sides(body)
        bones = [body.bones.index(solid.bone or "") for solid in carried]
        steps = bones_between(body.parents, bones)
        pairs = [
            (i, j)
            for i, j in combinations(range(len(carried)), 2)
            if steps[i, j] > 1 and arms[bones[i]] != arms[bones[j]]
        ]
        self._choose(pairs)
        data, neutral = model.createData(), pin.neutral(model)
        neutral[7:] = np.clip(neutral[7:], model.lowerPositionLimit[7:], model.upperPositionLimit[7:])
        pin.forwardKinematics(model, data, neutral)
        gaps = self._distances(model, data)
        self._choose([pair for pair, gap in zip(pairs, gaps, strict=True) if gap >= 0.0 or steps[pair] > NEAR])
        self._gaps, self._slopes = np.empty(0), np.empty((0, model.nv))

    def look_at(self, configuration: Any) -> None:
        """Note how far apart all that is near is, and how that changes, in a `pink.Configuration`."""
        import pinocchio as pin

        model, data = configuration.model, configuration.data
        gaps = self._distances(model, data)
        near = np.flatnonzero(gaps < _NOTICED)
        jacobians: dict[int, FloatArray] = {0: np.zeros((6, model.nv))}
        slopes = np.zeros((len(near), model.nv))
        results = [self._seen.distanceResults[k] for k in near.tolist()]
        normals = np.array([result.normal for result in results]).reshape(-1, 3)
        for side, sign in ((0, -1.0), (1, 1.0)):
            joints = [self._geometry.geometryObjects[self._pairs[k][side]].parentJoint for k in near.tolist()]
            points = [result.getNearestPoint2() if side else result.getNearestPoint1() for result in results]
            arms = np.reshape([p - data.oMi[j].translation for p, j in zip(points, joints, strict=True)], (-1, 3))
            # All in one go: NumPy's cross product takes as long for one pair of vectors as for a hundred.
            along = np.concatenate([normals, np.cross(arms, normals)], axis=1)
            for row, joint in enumerate(joints):
                if joint not in jacobians:
                    jacobians[joint] = pin.getJointJacobian(model, data, joint, pin.LOCAL_WORLD_ALIGNED)
                slopes[row] += sign * (along[row] @ jacobians[joint])
        self._gaps, self._slopes = gaps[near], slopes

    def compute_qp_objective(self, _: Any) -> tuple[FloatArray, FloatArray]:
        """Matrix H, shape (nv, nv), and vector c, shape (nv,), of 1/2 step H step + c step: what overlap costs."""
        inside = self._gaps < 0.0
        gaps, slopes = self._gaps[inside], self._slopes[inside]
        weights = _COST**2 / (1.0 + (gaps / _YIELDS) ** 2)
        return (weights * slopes.T) @ slopes, (weights * gaps) @ slopes

    def compute_qp_inequalities(self, _: Any, dt: float) -> tuple[FloatArray, FloatArray]:
        """Matrix G, shape (P, nv), and vector h, shape (P,), of G step <= h."""
        return -self._slopes, np.maximum(self._gaps, 0.0) + _INWARDS

    def _choose(self, pairs: Sequence[tuple[int, int]]) -> None:
        """Look at these pairs of solids from now on, and at no others."""
        import pinocchio as pin

        self._geometry.removeAllCollisionPairs()
        for pair in pairs:
            self._geometry.addCollisionPair(pin.CollisionPair(*pair))
        self._seen, self._pairs = self._geometry.createData(), tuple(pairs)

    def _distances(self, model: Any, data: Any) -> FloatArray:
        """Of each pair, negative where they overlap [m], shape (P,)."""
        import pinocchio as pin

        pin.updateGeometryPlacements(model, data, self._geometry, self._seen)
        pin.computeDistances(self._geometry, self._seen)
        return np.array([result.min_distance for result in self._seen.distanceResults])
