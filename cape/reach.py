"""Which colliders a cloth can reach at all in a motion: the others are left out before the first step.

A vertex gets no farther from where a bone holds the cloth than the cloth between the two is long (which Kim, Chentanez
and Müller-Fischer 2012, "Long Range Attachments", hold it back by). So all that the vertices nearest to a held one can
reach lies in a ball around it, and a collider that no ball comes near in any frame never meets the cloth.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cape.assembly import putting_on
from cape.assembly.geodesics import geodesic_distances
from cape.assembly.holding import attached_of
from cape.kernels.solve.attachments import Attached
from cape.scene.jumps import Cuts, rigid_motion
from cape.scene.poses import Pose, read_pose
from cape.scene.scene import Scene
from motions import quaternions
from skeleton.solid_measures import signed_distance
from skeleton.track import BoneTrack

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]

STRETCH = 0.15  # by which the way along a cloth in use may be longer than that along its pattern
MANY = 100  # colliders on one bone, of which most are no doubt far off
MOST_PLACES = 16  # on a bone at which a cloth is taken to be held; more vertices are lumped together
PUT_ON_SAMPLES = 17  # of the way of what is held, from where it starts to where it is worn


@dataclass(frozen=True, eq=False)
class Reach:
    """What a cloth can reach in a motion.

    Attributes:
        radius: of the largest ball around a held vertex [m]; 0 where all are held, infinite where some hang on nothing.
        stretch: the strain that it allows for.
        gaps: by how much each collider is out of reach at least [m], negative for one that is not, by name.
        frames: in which frame each is nearest, by name.
    """

    radius: float
    stretch: float
    gaps: Mapping[str, float]
    frames: Mapping[str, int]

    @property
    def left_out(self) -> dict[str, str]:
        """Why colliders are out of reach, by name."""
        return {
            name: f"at least {gap:.2f} m beyond the cloth's reach of {self.radius:.2f} m"
            for name, gap in self.gaps.items()
            if gap > 0.0
        }

    @property
    def kept(self) -> dict[str, str]:
        """Why colliders may be met, by name."""
        if np.isinf(self.radius):
            return dict.fromkeys(self.gaps, "nothing holds the cloth, which may get anywhere")
        return {
            name: f"within the cloth's reach of {self.radius:.2f} m, by {-gap:.2f} m at frame {self.frames[name]}"
            for name, gap in self.gaps.items()
            if gap <= 0.0
        }

    def cull(self, scene: Scene) -> Scene:
        """Give a scene without the colliders that are out of reach."""
        return replace(scene, colliders=tuple(c for c in scene.colliders if self.gaps[c.name] <= 0.0))


def reach_of(scene: Scene, track: BoneTrack, *, stretch: float = STRETCH) -> Reach:
    """Find which colliders a cloth can reach over a motion, also between its frames and while it is put on.

    Args:
        scene: cloth, attachments and colliders.
        track: poses of at least the bones that the scene uses.
        stretch: strain of the cloth to allow for.

    Raises:
        UnknownNameError: the scene uses a bone that the track has not.
        ValueRangeError: the cape can't be put on, or an attachment holds nothing.
    """
    names = [c.name for c in scene.colliders]
    held = _Held.of(scene, track, stretch)
    if held is None:
        return Reach(np.inf, stretch, dict.fromkeys(names, -np.inf), dict.fromkeys(names, 0))
    radii, inside = held.radii + held.left_behind(track.times), np.zeros(held.points.shape[:2])
    thickness = np.array([scene.thickness if c.thickness is None else c.thickness for c in scene.colliders])
    away, away_at = held.far_off()
    nearest: dict[int, tuple[FloatArray, IntArray]] = {}
    # What is held in one collider reaches farther, and may reach others that were too far off to be looked at.
    while len(new := np.setdiff1d(np.flatnonzero(away - thickness <= _farthest(radii, inside)), list(nearest))):
        for c, distances, least in held.clearances(new):
            # Bones hold a vertex that is in a collider at the collider's surface instead (`kernels.solve.attachments`).
            inside += np.maximum(thickness[c] + held.spreads - distances, 0.0)
            nearest[c] = least.min(axis=0), least.argmin(axis=0)
    radii = radii + inside.max(axis=0, initial=0.0)
    farthest = float(radii.max(initial=0.0))
    gaps, frames = {}, {}
    for c, name in enumerate(names):
        gap, at = away[c] - farthest, int(away_at[c])
        if c in nearest:
            beyond = nearest[c][0] - radii
            gap, at = beyond.min(), int(nearest[c][1][beyond == beyond.min()].min())
        gaps[name], frames[name] = float(gap - thickness[c]), max(at - held.before, 0)
    return Reach(farthest, stretch, gaps, frames)


def _farthest(radii: FloatArray, inside: FloatArray) -> float:
    return float((radii + inside.max(axis=0, initial=0.0)).max(initial=0.0))


@dataclass(frozen=True, eq=False)
class _Held:
    """n places at which bones hold a cloth, over the S samples of the time it takes to be put on and to move.

    Attributes:
        scene: with C colliders.
        positions: of its bones, and of the world as the last one, in the world [m], shape (S, B, 3).
        rotations: bone_to_world, shape (S, B, 4).
        bones: that hold, shape (n,).
        points: where, in the bones' frames [m], shape (S, n, 3).
        spreads: how far off the vertices are that such a place stands for [m], shape (n,).
        radii: of the balls around them that the cloth lies in [m], shape (n,).
        before: samples before the motion's first frame.
    """

    scene: Scene
    positions: FloatArray
    rotations: FloatArray
    bones: IntArray
    points: FloatArray
    spreads: FloatArray
    radii: FloatArray
    before: int

    @classmethod
    def of(cls, scene: Scene, track: BoneTrack, stretch: float) -> "_Held | None":
        """Find what is held where; None if a part of the cloth hangs on nothing."""
        chosen = [track.index(bone) for bone in scene.bones]
        poses = [
            read_pose(Pose(track.positions[f, chosen], track.rotations_wxyz[f, chosen]), scene.bones)
            for f in range(track.frames)
        ]
        first = putting_on.dressing_pose(scene, poses[0])
        start = putting_on.placed(scene, first)
        held = [putting_on.held_by(scene, attachment, first, start) for attachment in scene.attachments]
        hard = [(attachment, own) for attachment, own in zip(scene.attachments, held, strict=True) if attachment.hard]
        vertices = np.concatenate([*(own for _, own in hard), np.empty(0, np.int64)])
        distances, nearest = geodesic_distances(scene.cloth, vertices)
        if (nearest < 0).any():
            return None
        attached = attached_of(scene, [(attachment, own, own) for attachment, own in hard])
        if attached is None:
            return None
        worn, spread = putting_on.hold_points(scene, attached, hard, first, start)
        bones, off = putting_on.heaviest(attached), np.zeros(len(vertices))
        if attached.blend is not None:
            leads, off = attached.blend.starts[:-1], _off_heaviest(attached, worn, [first, *poses])
            worn, spread = worn[leads], spread[leads]
        shares = np.linspace(0.0, 1.0, PUT_ON_SAMPLES)[:-1]
        poses = [first.towards(poses[0], float(share)) for share in shares] + poses
        positions = np.stack([pose.positions for pose in poses])
        rotations = np.stack([pose.rotations_wxyz for pose in poses])
        farthest = (1.0 + stretch) * distances
        # Wherever the cloth starts, and where its neckline is tried for being in a collider.
        for at, places in ((spread, start), (worn, putting_on.places_worn(scene, first, start))):
            held_at = positions[0, bones] + quaternions.rotate(rotations[0, bones], at)
            farthest = np.maximum(farthest, np.linalg.norm(places - held_at[nearest], axis=1))
        radii = np.zeros(len(vertices))
        np.maximum.at(radii, nearest, farthest)
        radii += off
        chosen, place, off = _lumped(bones, np.concatenate([spread, worn], axis=1))
        spreads, lumped_radii = np.zeros(len(chosen)), np.zeros(len(chosen))
        np.maximum.at(spreads, place, off)
        np.maximum.at(lumped_radii, place, radii + off)
        spread, worn = spread[chosen], worn[chosen]
        points = np.concatenate([spread + shares[:, None, None] * (worn - spread), np.tile(worn, (track.frames, 1, 1))])
        return cls(scene, positions, rotations, bones[chosen], points, spreads, lumped_radii, PUT_ON_SAMPLES - 1)

    def left_behind(self, times: FloatArray) -> FloatArray:
        """How far a cloth that jumps along with its bones as a whole is off where they hold it then [m], shape (n,).

        `times` of the motion's frames [s], shape (F,).
        """
        off, cuts, holding = np.zeros(len(self.bones)), Cuts(), np.unique(self.bones)
        places = self.positions[:, self.bones] + quaternions.rotate(self.rotations[:, self.bones], self.points)
        for frame, step in enumerate(np.diff(times), start=self.before):
            before, after = (Pose(self.positions[f], self.rotations[f]) for f in (frame, frame + 1))
            if cuts.between(before, after, float(step), holding):
                rotation, shift = rigid_motion(places[frame], places[frame + 1])
                off += np.linalg.norm(places[frame] @ rotation.T + shift - places[frame + 1], axis=1)
        return off

    def clearances(self, colliders: IntArray) -> Iterator[tuple[int, FloatArray, FloatArray]]:
        """Each collider with the distances [m] of what is held from it at the samples (S, n), and at least until the
        next (S - 1, n): nowhere on a line of length l is a distance less than (d0 + d1 - l) / 2."""
        bones = self.scene.enclosing.bones[colliders]
        for own in np.unique(bones).tolist():
            places, slack = self._seen_from(own)
            for c in colliders[bones == own].tolist():
                found = signed_distance(self.scene.colliders[c], places.reshape(-1, 3)).reshape(places.shape[:2])
                yield c, found, (found[1:] + found[:-1]) / 2.0 - slack

    def far_off(self) -> tuple[FloatArray, IntArray]:
        """How far off what is held each collider is at least [m], shape (C,), and at which sample, shape (C,).

        That is found for bones with many colliders, by balls around these; of the others nothing is known (-inf).
        """
        balls = self.scene.enclosing
        away, at = np.full(len(balls.radii), -np.inf), np.zeros(len(balls.radii), dtype=np.int64)
        for own in np.flatnonzero(np.bincount(balls.bones) > MANY).tolist():
            rows = np.flatnonzero((balls.bones == own) & np.isfinite(balls.radii))
            places, slack = self._seen_from(own)
            found, nearest = _nearest(places.reshape(-1, 3), balls.centers[rows])
            away[rows] = found - balls.radii[rows] - slack.max(initial=0.0)
            at[rows] = nearest // places.shape[1]
        return away, at

    def _seen_from(self, own: int) -> tuple[FloatArray, FloatArray]:
        """Places of what is held in a bone's frame at the samples [m], (S, n, 3), and by how much less than the mean of
        its distances there a distance can be until the next sample [m], (S - 1, n).

        Between samples a bone's origin moves in a straight line and the bone turns at a constant rate. In the other
        bone's frame a held point p then leaves the straight line between its places q at both samples by at most
        max |q''| / 8, where q = Rc^-1 (L + Rb p) and L is the way from the one bone's origin to the other's.
        """
        origins, turns = self.positions[:, self.bones], self.rotations[:, self.bones]
        to_frame = quaternions.conjugate(self.rotations[:, own : own + 1])
        apart = origins - self.positions[:, own : own + 1]
        places = quaternions.rotate(to_frame, apart + quaternions.rotate(turns, self.points))
        turned, own_turn = _angles(turns), _angles(self.rotations[:, own : own + 1])
        length = np.linalg.norm(apart, axis=2)
        bend = own_turn**2 * np.maximum(length[1:], length[:-1])
        bend += 2.0 * own_turn * np.linalg.norm(np.diff(apart, axis=0), axis=2)
        bend += (own_turn + turned) ** 2 * np.linalg.norm(self.points, axis=2).max(axis=0)
        bend[:, self.bones == own] = 0.0
        ways = np.linalg.norm(np.diff(places, axis=0), axis=2)
        return places, ways / 2.0 + bend / 8.0


def _nearest(points: FloatArray, places: FloatArray) -> tuple[FloatArray, IntArray]:
    """How far from each of n places the nearest of some points is [m], shape (n,), and which it is, shape (n,)."""
    from scipy.spatial import KDTree

    found, nearest = KDTree(points).query(places)
    return np.asarray(found), np.asarray(nearest, dtype=np.int64)


def _off_heaviest(attached: Attached, points: FloatArray, poses: list[Pose]) -> FloatArray:
    """How far n vertices that several bones hold are at most from where the heaviest of them would [m], shape (n,).

    `points` are in the bones' frames [m], shape (m, 3).
    """
    held = attached._replace(points=points)
    lead, off = putting_on.heaviest(attached), np.zeros(len(attached.vertices))
    alone = points[attached.blend.starts[:-1]] if attached.blend is not None else points
    for pose in poses:
        by_one = pose.positions[lead] + quaternions.rotate(pose.rotations_wxyz[lead], alone)
        off = np.maximum(off, np.linalg.norm(putting_on.carried_points(held, pose) - by_one, axis=1))
    return off


def _lumped(bones: IntArray, points: FloatArray) -> tuple[IntArray, IntArray, FloatArray]:
    """Choose at most `MOST_PLACES` of each bone's points, each next one the farthest from those before.

    `bones` (n,) hold the points, which are given by the coordinates of several places [m], shape (n, 3 k). Returns the
    chosen ones (m,), and for each point which of them is nearest and how far it is off at most [m], shape (n,) each.
    """
    chosen: list[int] = []
    nearest, off = np.zeros(len(bones), dtype=np.int64), np.full(len(bones), np.inf)
    for bone in np.unique(bones):
        own = np.flatnonzero(bones == bone)
        for _ in range(min(MOST_PLACES, len(own))):
            chosen.append(int(own[off[own].argmax()]))
            away = points[own] - points[chosen[-1]]
            distances = np.linalg.norm(away.reshape(len(own), -1, 3), axis=2).max(axis=1)
            closer = distances < off[own]
            nearest[own[closer]], off[own[closer]] = len(chosen) - 1, distances[closer]
    return np.array(chosen, dtype=np.int64), nearest, off


def _angles(rotations: FloatArray) -> FloatArray:
    """Angles between successive rotations (S, ..., 4) [rad], shape (S - 1, ...)."""
    turns = quaternions.multiply(rotations[1:], quaternions.conjugate(rotations[:-1]))
    return np.linalg.norm(quaternions.to_rotation_vector(turns), axis=-1)
