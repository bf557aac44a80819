"""Hitboxes of a robot, or of a character with a mesh: solids fitted to its links, and how well they fit."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.border import checked
from motions.errors import ValueRangeError
from skeleton.model import Skeleton
from skeleton.robot.capsule_fitting import QUANTILE, fit_solids, weighted_quantile
from skeleton.robot.links import Link, LinkReport, body_height, find_links, in_neutral_pose
from skeleton.robot.mirror import Mirror
from skeleton.robot.solid_files import read_solids, write_solids
from skeleton.shapes import Bounded, Capsule, Shape, TaperedCapsule
from skeleton.skinned.bind_pose import in_bind_pose
from skeleton.solid_measures import signed_distance, union_volume

FloatArray = NDArray[np.float64]

Kind = Literal["capsule", "tapered_capsule"]

_KINDS: Mapping[Kind | None, tuple[type[Capsule] | type[TaperedCapsule], ...]] = {
    None: (Capsule, TaperedCapsule),
    "capsule": (Capsule,),
    "tapered_capsule": (TaperedCapsule,),
}

INSIDE = 0.005
"""How far a link may stick out of others [m] and still count as inside of them: cloth is stopped about as far out."""

_NEAR = 3  # joints between a link and what hides it: a shoulder or a hip has as many, of one axis each
_SMALL = 0.05  # of the body's height: a finger, not a hand
_WORTH_A_SOLID = 0.02  # of the volume of all links: least saving of a second solid
_MOST_SOLIDS = 3  # around one link


@dataclass(frozen=True)
class Quality:
    """How well the solids of a link fit the surface that they were fitted to.

    Attributes:
        solids: names of the link's solids.
        geometry: "collision" or "visual", where the surface is from.
        outside: share of the surface that sticks out of them.
        most: how far it sticks out at most [m].
        p99: how far at most, but for a hundredth of the surface [m].
        volume_ratio: volume of the solids' union in that of the link's convex hull.
    """

    solids: tuple[str, ...]
    geometry: Literal["collision", "visual"]
    outside: float
    most: float
    p99: float
    volume_ratio: float


@checked
@dataclass(frozen=True, eq=False)
class Hitboxes:
    """Solids in the frames of a body's bones.

    Attributes:
        robot: what the body is called.
        solids: with names of their own: the role of a limb whose main link it is, else the link's name, and a number
            where a link has several.
        left_out: why there is nothing around a link, by its name.
        qualities: of the links that solids were fitted to, by the link's name.
        decisions: what had to be decided, a sentence each.
    """

    robot: str
    solids: tuple[Shape, ...]
    left_out: Mapping[str, str] = field(default_factory=dict)
    qualities: Mapping[str, Quality] = field(default_factory=dict)
    decisions: tuple[str, ...] = ()

    def save(self, path: str | Path) -> None:
        """Write a TOML file that people can edit and `load_hitboxes` reads: robot, solids, and remarks on their fit.

        Raises:
            FileError: the file can't be written.
        """
        remarks = {quality.solids[0]: _remark(link, quality) for link, quality in self.qualities.items()}
        write_solids(path, self.robot, self.solids, remarks)


@checked
def load_hitboxes(path: str | Path, body: Skeleton | None = None) -> Hitboxes:
    """Read hitboxes from a TOML file; see `skeleton.solid_files` for what it holds.

    Args:
        path: the file.
        body: whose bones, or links, they have to be on; not checked by default.

    Raises:
        FileError: the file is missing or malformed, or names a bone that the body doesn't have; names the table, and
            what it may hold.
    """
    robot, solids = read_solids(path, None if body is None else (*body.bones, *body.links))
    if body is not None:
        solids = tuple(s if s.bone is None else replace(s, bone=body.bones[body.bone(s.bone)]) for s in solids)
    return Hitboxes(robot, solids)


@checked
def hitboxes_of(
    body: Skeleton,
    *,
    which: Literal["limbs", "all"] = "limbs",
    quantile: float = QUANTILE,
    kind: Kind | None = None,
) -> Hitboxes:
    """Fit solids to the links of a robot, or to a character's mesh, of which each bone's part is a link.

    A link's collision geometry counts, the visual one where there is none or it stands for nothing. Spheres, boxes and
    capsules of the file are taken as they are. A link that one solid fills badly gets up to three. What is the mirror
    image of another link gets the mirror images of its solids. A body without geometry of its own gets capsules by the
    proportions of the human body.

    Args:
        body: the robot, or the character.
        which: "limbs" leaves out a robot's fingers, and what lies inside of other links' solids in the neutral pose,
            and takes a character's fingers for parts of its hands; "all" is everything that has a surface.
        quantile: share of a link's surface that its solids hold, above 0 and up to 1.
        kind: "capsule" or "tapered_capsule" for only these; by default whichever is smaller.

    Raises:
        ValueRangeError: an option that doesn't exist, or the quantile is out of range.
        FileError: a mesh is missing or can't be read.
    """
    if which not in ("limbs", "all"):
        raise ValueRangeError(f"which hitboxes: 'limbs' or 'all', not {which!r}")
    if kind not in _KINDS:
        raise ValueRangeError(f"a hitbox is a 'capsule' or a 'tapered_capsule', not {kind!r}")
    if not 0.0 < quantile <= 1.0:
        raise ValueRangeError(f"the share of a surface to hold is above 0 and up to 1, got {quantile}")
    if body.skin is not None:  # solids are in bones' frames: any pose will do in which both sides are alike
        body = replace(body, rest=in_bind_pose(body.rest, body.skin))
    report = find_links(body, limbs_only=which == "limbs")
    if not report.links:
        return _by_proportions(body, report)
    fit = _Fit(body, report, quantile, kind)
    fit.add_all(limbs_only=which == "limbs")
    return Hitboxes(body.name, tuple(fit.solids), fit.left_out, fit.qualities, tuple(report.decisions))


def _by_proportions(body: Skeleton, report: LinkReport) -> Hitboxes:
    decision = "no link has geometry that makes sense: capsules by the proportions of the human body"
    left_out = {**report.left_out, **body.capsules_left_out()}
    return Hitboxes(body.name, body.capsules(), left_out, {}, (*report.decisions, decision))


class _Fit:
    """The solids of a robot, link by link."""

    def __init__(self, body: Skeleton, report: LinkReport, quantile: float, kind: Kind | None):
        self.body = body
        self.quantile = quantile
        self.kinds = _KINDS[kind]
        # Main links first, then the others, the large ones before the small ones that they may hide.
        self.links = sorted(report.links, key=lambda link: (link.role is None, -link.hull_volume))
        self.left_out = dict(report.left_out)
        self.qualities: dict[str, Quality] = {}
        self.mirror = Mirror.of(body)
        self.solids_of: dict[Link, tuple[Bounded, ...]] = {}
        self.fits: dict[Link, tuple[Capsule | TaperedCapsule, ...]] = {}

    @property
    def solids(self) -> list[Bounded]:
        """All solids, in the order of the bones."""
        order = {bone: place for place, bone in enumerate((None, *self.body.bones))}
        solids = [solid for own in self.solids_of.values() for solid in own]
        return sorted(solids, key=lambda solid: order[solid.bone])

    def add_all(self, *, limbs_only: bool) -> None:
        """Fit solids to the links, to those alone that matter if `limbs_only`."""
        least_saving = _WORTH_A_SOLID * sum(link.hull_volume for link in self.links)
        for link in self.links:
            if limbs_only and link.role is None and (reason := self._superfluous(link)):
                self.left_out[link.name] = reason
                continue
            solids = self._named(link, self._solids_around(link, least_saving))
            self.solids_of[link] = solids
            self.qualities[link.name] = _quality(link, solids)

    def _superfluous(self, link: Link) -> str | None:
        """Why a limb is complete without this link, None if it isn't."""
        height = body_height(self.body)
        if link.end_of and height is not None and link.size < _SMALL * height:
            return f"at the {link.end_of.replace('_', ' ')} and small, {1000 * link.size:.0f} mm"
        points = in_neutral_pose(self.body, link.bone, link.points)
        near = [other for other in self.solids_of if self._joints_between(link, other) <= _NEAR]
        if not near:
            return None
        distances = np.stack([self._distances(other, points) for other in near])
        reach = weighted_quantile(distances.min(axis=0), link.areas, self.quantile)
        if reach > INSIDE:
            return None
        hidden = sorted({near[i].name for i in np.unique(distances.argmin(axis=0))})
        return "inside of " + ", ".join(hidden)

    def _distances(self, link: Link, points: FloatArray) -> FloatArray:
        """Of points of the world in the neutral pose from a link's solids [m], shape (N,)."""
        if link.bone is not None:
            index = self.body.bones.index(link.bone)
            rest = self.body.rest
            turn = quaternions.conjugate(rest.rotations_wxyz[index])
            points = quaternions.rotate(turn, points - rest.positions[index])
        return np.min([signed_distance(solid, points) for solid in self.solids_of[link]], axis=0)

    def _joints_between(self, link: Link, other: Link) -> int:
        """Number of joints on the way from one link to the other."""
        above, others = (self._bones_above(one.bone) for one in (link, other))
        shared = len(set(above) & set(others))
        return len(above) + len(others) - 2 * shared

    def _bones_above(self, bone: str | None) -> list[int]:
        """Numbers of a bone and of all bones above it that move."""
        chain = [] if bone is None else [self.body.bones.index(bone)]
        while chain and (parent := int(self.body.parents[chain[-1]])) >= 0:
            chain.append(parent)
        return [bone for bone in chain if not self.body.carriers.fixed[bone]]

    def _solids_around(self, link: Link, least_saving: float) -> tuple[Bounded, ...]:
        """Primitives as they are, and solids around the rest."""
        meshed = np.ones(len(link.points), bool)
        for _, first, last in link.primitives:
            meshed[first:last] = False
        primitives = tuple(primitive for primitive, _, _ in link.primitives)
        if not meshed.any():
            return primitives
        points, areas = link.points[meshed], link.areas[meshed]
        original = self.mirror.original(link, self.fits) if self.mirror is not None else None
        if self.mirror is not None and original is not None:
            image = [self.mirror.onto(link, solid, original) for solid in self.fits[original]]
            fitted = _grown_to_hold(image, points, areas, self.quantile)
        else:
            fitted = fit_solids(
                points,
                weights=areas,
                quantile=self.quantile,
                kinds=self.kinds,
                most=_MOST_SOLIDS,
                least_saving=least_saving,
            )
        self.fits[link] = tuple(replace(solid, bone=link.bone) for solid in fitted)
        return (*primitives, *self.fits[link])

    def _named(self, link: Link, solids: Sequence[Bounded]) -> tuple[Bounded, ...]:
        """The solids with names that none has yet."""
        taken = {solid.name for own in self.solids_of.values() for solid in own}
        name = link.role or link.name
        while any(one in taken for one in _names(name, len(solids))):
            name += "_link"
        return tuple(replace(solid, name=one) for solid, one in zip(solids, _names(name, len(solids)), strict=True))


def _names(name: str, count: int) -> list[str]:
    return [name] if count == 1 else [f"{name}_{number}" for number in range(1, count + 1)]


def _grown_to_hold(
    solids: Sequence[Capsule | TaperedCapsule], points: FloatArray, areas: FloatArray, quantile: float
) -> tuple[Capsule | TaperedCapsule, ...]:
    """The solids, so much thicker that their union holds the share of the points."""
    distances = np.min([signed_distance(solid, points) for solid in solids], axis=0)
    lack = max(weighted_quantile(distances, areas, quantile), 0.0)
    return tuple(solid.grown(lack) for solid in solids)


_ROUNDING = 1e-9
"""[m] of a distance that a point on a solid's surface may have."""


def _quality(link: Link, solids: Sequence[Bounded]) -> Quality:
    distances = np.min([signed_distance(solid, link.points) for solid in solids], axis=0)
    sticking = np.maximum(distances, 0.0)
    return Quality(
        solids=tuple(solid.name for solid in solids),
        geometry=link.geometry,
        outside=float(link.areas[distances > _ROUNDING].sum() / link.areas.sum()),
        most=float(sticking.max()),
        p99=weighted_quantile(sticking, link.areas, 0.99),
        volume_ratio=union_volume(solids) / link.hull_volume if link.hull_volume > 0.0 else float("inf"),
    )


def _remark(link: str, quality: Quality) -> str:
    return (
        f"{link}, {quality.geometry} geometry: {quality.outside:.1%} of the surface sticks out, "
        f"{1000.0 * quality.most:.1f} mm at most; {quality.volume_ratio:.2f} times the hull's volume"
    )
