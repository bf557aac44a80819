"""The links of a body as points on their surfaces: the geometry that stands for each, and the role that it plays.

A robot's links are those of its file. Of a character with a mesh it is what of that follows each bone.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.errors import FileError, UnknownNameError
from skeleton.model import Skeleton
from skeleton.rest import NEXT_ROLE
from skeleton.robot.capsule_fitting import hull_volume, surface_points
from skeleton.robot.meshes.link_surfaces import Kind, LinkSurface, link_surfaces
from skeleton.shapes import Box, Capsule, Sphere
from skeleton.skinned.surfaces import bone_surfaces, joined

FloatArray = NDArray[np.float64]

_STANDS_FOR = 0.25
"""Collision geometry whose box has less than this share of the visual one's, such as four balls under a foot's sole,
tells where a link touches the ground, not where it is."""
_OVERSIZE = 0.5
"""Of the body's height: what is thicker in all directions is no part of the body."""
_PRECEDENCE = ("pelvis", "chest", "head", "neck")
"""Of the roles that share a bone the first of these names its main link, before all others."""


@dataclass(frozen=True, eq=False)
class Link:
    """A link of a robot.

    Attributes:
        name: as in the robot's file.
        bone: name of the bone that carries it, None for one that stands still in the world.
        geometry: which of its geometries the points are taken from.
        points: on its surface, in the bone's frame, in the world's without a bone [m], shape (N, 3).
        areas: of the surface that each point stands for [m^2], shape (N,).
        primitives: solids of the file, each with the number of its first point and the number after its last.
        hull_volume: of the convex hull of all of the surface [m^3].
        role: whose main link it is, None for any other link.
        end_of: the role of the hand that the link belongs to or hangs from.
    """

    name: str
    bone: str | None
    geometry: Kind
    points: FloatArray
    areas: FloatArray
    hull_volume: float
    primitives: tuple[tuple[Sphere | Capsule | Box, int, int], ...] = ()
    role: str | None = None
    end_of: str | None = None

    @property
    def size(self) -> float:
        """Diagonal of the upright box around it [m]."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))


@dataclass
class LinkReport:
    """What was found out about a robot's links.

    Attributes:
        links: those with geometry that makes sense.
        left_out: why a link or a piece of one is not among them, by name.
        decisions: what else had to be decided, a sentence each.
    """

    links: list[Link] = field(default_factory=list)
    left_out: dict[str, str] = field(default_factory=dict)
    decisions: list[str] = field(default_factory=list)


def find_links(body: Skeleton, *, limbs_only: bool = False) -> LinkReport:
    """All links of a body that have a surface: their collision geometry, the visual one where that stands for nothing.

    Args:
        body: a robot, a character with a mesh, or a body without either, which has no links.
        limbs_only: whether fingers, and other small bones of a character, count as parts of their limbs.

    Raises:
        FileError: neither the collision nor the visual meshes can be read.
    """
    report = LinkReport()
    if not body.is_robot:
        report.links = _with_roles(body, _links_of_skin(body, limbs_only=limbs_only))
        return report
    pieces = _all_pieces(body, report)
    height = body_height(body)
    for name in dict.fromkeys(piece.link for kind in pieces.values() for piece in kind):
        own = {kind: _plausible([p for p in some if p.link == name], height, report) for kind, some in pieces.items()}
        kind: Kind = "collision" if own["collision"] else "visual"
        if own["collision"] and own["visual"]:
            share = _box_volume(own["collision"]) / _box_volume(own["visual"])
            if share < _STANDS_FOR:
                kind = "visual"
                report.decisions.append(
                    f"{name}: its collision geometry takes up {share:.0%} of the room of its visual one, which is used"
                )
        if own[kind] and (link := _link(name, kind, own[kind])) is not None:
            report.links.append(link)
    report.links = _with_roles(body, report.links)
    return report


def body_height(body: Skeleton) -> float | None:
    """Standing height of a body [m], None for one whose limbs aren't known."""
    try:
        return body.height()
    except UnknownNameError:
        return None


def in_neutral_pose(body: Skeleton, bone: str | None, points: FloatArray) -> FloatArray:
    """Points (N, 3) of a bone's frame in the world [m], the robot in its neutral pose, shape (N, 3)."""
    if bone is None:
        return points
    index = body.bones.index(bone)
    return body.rest.positions[index] + quaternions.rotate(body.rest.rotations_wxyz[index], points)


def _links_of_skin(body: Skeleton, *, limbs_only: bool) -> list[Link]:
    """What of a character's mesh follows each bone; none of a body without a mesh."""
    if body.skin is None:
        return []
    surfaces = bone_surfaces(body.skin, body.bones)
    if limbs_only:
        surfaces = joined(surfaces, body.rest, _segments(body))
    links = []
    for surface in surfaces:
        if np.ptp(surface.vertices, axis=0).any():
            points, areas = surface_points(surface.vertices, surface.triangles)
            links.append(Link(surface.bone, surface.bone, "visual", points, areas, hull_volume(points)))
    return links


def _all_pieces(body: Skeleton, report: LinkReport) -> dict[Kind, tuple[LinkSurface, ...]]:
    """Collision and visual pieces; if one of them can't be read, the other has to do."""
    pieces: dict[Kind, tuple[LinkSurface, ...]] = {"collision": (), "visual": ()}
    errors = []
    for kind in pieces:
        try:
            pieces[kind] = link_surfaces(body, kind)
        except FileError as error:
            errors.append(error)
            report.decisions.append(str(error))
    if len(errors) == len(pieces):
        raise errors[0]
    return pieces


def _plausible(pieces: Sequence[LinkSurface], height: float | None, report: LinkReport) -> list[LinkSurface]:
    """Pieces that have corners and that a body of this height [m] can have."""
    kept = []
    for piece in pieces:
        if not len(piece.vertices):
            continue
        thinnest = float(np.ptp(piece.vertices, axis=0).min())
        if height is not None and thinnest > _OVERSIZE * height:
            report.left_out[piece.name] = f"{thinnest:.2f} m thick, on a body {height:.2f} m tall"
        else:
            kept.append(piece)
    return kept


def _box_volume(pieces: Sequence[LinkSurface]) -> float:
    """Volume of the upright box around pieces, no edge thinner than a millimetre [m^3]."""
    corners = np.concatenate([piece.vertices for piece in pieces])
    return float(np.prod(np.maximum(np.ptp(corners, axis=0), 1e-3)))


def _link(name: str, kind: Kind, pieces: Sequence[LinkSurface]) -> Link | None:
    """The pieces as one link, None where they have no area."""
    points, areas, primitives, count = [], [], [], 0
    for piece in pieces:
        if not np.ptp(piece.vertices, axis=0).any() or not len(piece.triangles):
            continue
        some, some_areas = surface_points(piece.vertices, piece.triangles)
        if piece.primitive is not None:
            primitives.append((piece.primitive, count, count + len(some)))
        points.append(some)
        areas.append(some_areas)
        count += len(some)
    if not points:
        return None
    joined = np.concatenate(points)
    return Link(name, pieces[0].bone, kind, joined, np.concatenate(areas), hull_volume(joined), tuple(primitives))


def _with_roles(body: Skeleton, links: Sequence[Link]) -> list[Link]:
    """The links, each with the role whose main link it is: the largest on the role's bone, or below it."""
    segments = _segments(body)
    main: dict[str, tuple[bool, float, str]] = {}
    for link in links:
        role = segments.get(link.bone or "")
        if role is not None:
            rank = (link.bone == body.roles[role], link.hull_volume, link.name)
            main[role] = max(main.get(role, rank), rank)
    role_of = {name: role for role, (_, _, name) in main.items()}
    hands = {link.name: segments.get(link.bone or "") for link in links}
    return [
        replace(
            link,
            role=role_of.get(link.name),
            end_of=hands[link.name] if (hands[link.name] or "").endswith("_hand") else None,
        )
        for link in links
    ]


def _segments(body: Skeleton) -> Mapping[str, str]:
    """The role that each bone belongs to: its own, one that it lies on the way from, or the nearest above it."""
    order = [*(role for role in _PRECEDENCE if role in body.roles), *body.roles]
    own = {body.roles[role]: role for role in reversed(order)}
    between = {}
    for role, following in NEXT_ROLE.items():
        if role in body.roles and following in body.roles:
            way = body.rest.chain(body.rest.bone(role), body.rest.bone(following))
            between |= {body.bones[bone]: role for bone in way[1:-1]}
    found: dict[str, str] = {}
    for bone, parent in zip(body.bones, body.parents, strict=True):
        role = own.get(bone) or between.get(bone) or (found.get(body.bones[parent]) if parent >= 0 else None)
        if role is not None:
            found[bone] = role
    return found
