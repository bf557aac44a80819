"""`cape info` and `cape clips`: what a motion or a robot holds, which clips there are."""

import json as jsonlib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from itertools import groupby
from pathlib import Path

import numpy as np

import motions
from cape.cli.character import find_hitboxes, read_character, usual_hitboxes
from cape.cli.figures.retargeting import retarget_facts, retarget_rows
from cape.cli.figures.rows import print_rows
from cape.cli.reading import Reading
from cape.cli.words import gathered, shortened
from cape.reach import reach_of
from cape.scene.colliders import Collider
from cape.scene.dress import dress
from cape.scene.jumps import Cuts, seam
from cape.start import check_start
from motions.bodies.roles import ROLES
from motions.errors import UserError
from skeleton import ROBOTS, BoneTrack, Finding, Skeleton, check_motion, column_names
from skeleton.robot.links import body_height

TOLD_OF_A_KIND = 3


@dataclass(frozen=True, eq=False)
class _Subject:
    """What there is to tell of: a body, and its motion where there is one.

    Attributes:
        rows: what it is.
        body: the skeleton.
        names: of its joints.
        track: its motion.
        solids: around its limbs.
        left_out: why others are missing, by their names.
        decisions: what had to be decided, a sentence each.
        human: whether it is of a human's size and speed.
    """

    rows: list[tuple[str, str]]
    body: Skeleton
    names: tuple[str, ...]
    track: BoneTrack | None
    solids: tuple[Collider, ...]
    left_out: Mapping[str, str]
    decisions: tuple[str, ...]
    human: bool

    @property
    def height(self) -> float | None:
        """Standing height [m], None where it is unknown."""
        return None if self.human and "head" not in self.body.roles else body_height(self.body)


def run(reading: Reading, *, hitboxes: str | None = None, json: bool = False) -> int:
    """Tell what a motion or a robot holds; gives the exit status."""
    subject = _robot_alone(reading) or _subject(reading, hitboxes)
    body, height = subject.body, subject.height
    findings = _findings(subject)
    facts = [
        *subject.rows,
        ("body", "of unknown height" if height is None else f"{height:.2f} m tall"),
        *(("decided", decision) for decision in gathered(subject.decisions)),
        *(("role", f"{role}: {body.roles[role]}") for role in ROLES if role in body.roles),
        ("capsules", ", ".join(solid.name for solid in subject.solids) or "none"),
        *(("left out", f"{name}: {reason}") for name, reason in subject.left_out.items()),
        *_jump_rows(subject),
        *_cape_rows(subject),
        *(("check", text) for text in _told(findings)),
        *(("warning", text) for text in _warnings(subject)),
        ("joint names", ", ".join(subject.names)),
    ]
    if json:
        rows = [list(row) for row in facts if row[0] != "check"]
        print(jsonlib.dumps({"rows": rows, "findings": [asdict(finding) for finding in findings]}))
    else:
        print_rows(facts)
    return 0


def _robot_alone(reading: Reading) -> _Subject | None:
    """A robot without a motion, None where a motion is named."""
    name = reading.clip
    if name is None or reading.skeleton is not None or not (name in ROBOTS or Path(name).suffix.lower() == ".urdf"):
        return None
    robot = reading.robot(name)
    fixed = int(robot.carriers.fixed.sum())
    rows = [
        ("robot", robot.name),
        ("joints", f"{len(robot.bones) - fixed}, a configuration has {robot.model.nq} numbers"),
        *([("fixed", f"{fixed} more bones, which are fixed to those")] if fixed else []),
        *([("mimics", f"{len(robot.mimics)} joints follow others")] if robot.mimics else []),
        ("numbers", ", ".join(column_names(robot))),
    ]
    return _Subject(rows, robot, robot.bones, None, (), {}, robot.decisions, human=False)


def _subject(reading: Reading, hitboxes: str | None) -> _Subject:
    """A clip with the body that it moves, or a robot with its motion."""
    if reading.skeleton is None:
        clip = reading.load_as_is()
        body = reading.body(clip)
        solids = find_hitboxes(body, hitboxes or usual_hitboxes(body))
        rows = [
            ("clip", clip.name),
            ("motion", f"{clip.frames} frames at {clip.fps:g} fps, {clip.duration:.2f} s"),
            ("joints", f"{len(clip.joints)} and {len(clip.end_parents)} end sites, root {clip.joints[0]!r}"),
            *_skin_rows(clip),
        ]
        track = body.track(clip) if clip.frames > 1 else None
        return _Subject(
            rows,
            body,
            clip.joints,
            track,
            solids.solids,
            solids.left_out,
            (*clip.decisions, *body.decisions),
            human=True,
        )
    who = read_character(reading, hitboxes=hitboxes)
    track, solids = who.track, who.hitboxes
    rows = [
        ("motion", f"{who.name}: {track.frames} frames at {track.fps:g} fps, {track.times[-1] - track.times[0]:.2f} s"),
        ("robot", who.body.name),
        *([] if who.retargeted is None else retarget_rows(retarget_facts(who.retargeted))),
    ]
    return _Subject(rows, who.body, who.body.bones, track, solids.solids, solids.left_out, who.decisions, human=False)


def _skin_rows(clip: motions.Clip) -> list[tuple[str, str]]:
    """Tell of the mesh that comes with a motion."""
    if (skin := clip.skin) is None:
        return []
    pieces = ", ".join(piece.name for piece in skin.pieces)
    morphs = f", {skin.morphs} morph target{'s that move' if skin.morphs > 1 else ' that moves'}" if skin.morphs else ""
    joints = len(set(skin.bones))
    return [("mesh", f"{skin.vertices} vertices, {skin.triangles} triangles on {joints} joints{morphs}: {pieces}")]


def _findings(subject: _Subject) -> list[Finding]:
    """What deserves a look in the motion, and where a cape would start."""
    if subject.track is None:
        return []
    findings = [*check_motion(subject.track, subject.solids, height=subject.height if subject.human else None)]
    with suppress(UserError):  # there is no cape then; `_cape_rows` tells why
        findings += check_start(dress(subject.body, subject.track, colliders=subject.solids), subject.track)
    return findings


def _told(findings: Sequence[Finding]) -> list[str]:
    """The worst findings of each kind, and how many more there are."""
    texts = []
    for kind, group in groupby(findings, key=lambda finding: finding.kind):
        of_kind = [f"{kind}: {finding.text}" for finding in group]
        texts += of_kind[:TOLD_OF_A_KIND]
        if more := len(of_kind) - TOLD_OF_A_KIND:
            texts += [f"{kind}: {more} more, see --json"] if more > 0 else []
    return texts


def _jump_rows(subject: _Subject) -> list[tuple[str, str]]:
    """Tell where the bones jump, and whether they do where the motion begins again."""
    track, cuts, rows = subject.track, Cuts(), []
    if track is None:
        return []
    holding = [role for role in ("left_shoulder", "right_shoulder") if role in subject.body.roles]
    if jumps := cuts.frames(track, holding):
        rows.append(("jumps", f"the bones jump at frame {', '.join(map(str, jumps))}: a cape is carried along"))
    way = float(np.linalg.norm(track.positions[0] - track.positions[-1], axis=1).max())
    again = f"the first frame is up to {way:.2f} m from the last"
    if cuts.frames(seam(track), holding):
        rows.append(("loop", f"{again}, a jump: a cape is carried along"))
    else:
        rows.append(("loop", f"{again}, no jump"))
    return rows


def _cape_rows(subject: _Subject) -> list[tuple[str, str]]:
    """Tell what a cape would be and what it can't reach, or why there is none."""
    if subject.track is None:
        return []
    try:
        scene = dress(subject.body, subject.track, colliders=subject.solids)
        reach = reach_of(scene, subject.track)
    except UserError as error:
        return [("cape", f"none: {shortened(error.at_command_line)}")]
    return [
        ("cape", f"{scene.cloth.vertices} vertices that reach {reach.radius:.2f} m"),
        *(("beyond reach", f"{name}: {reason}") for name, reason in reach.left_out.items()),
    ]


def list_clips() -> int:
    """List the shipped clips; gives the exit status."""
    rows = []
    for name in motions.clip_names():
        clip = motions.load(name)
        travel = float(((clip.root_positions[-1, :2] - clip.root_positions[0, :2]) ** 2).sum() ** 0.5)
        rows.append((name, f"{clip.duration:.1f} s at {clip.fps:g} fps, travels {travel:.1f} m"))
    print_rows(rows)
    return 0


def _warnings(subject: _Subject) -> list[str]:
    roles = subject.body.roles
    missing = [role for role in ROLES if role not in roles and not role.endswith("hand")]
    warnings = []
    if subject.track is None and not subject.body.is_robot:
        warnings.append("a single frame: no motion to replay")
    if missing:
        warnings.append(f"no bone found for {', '.join(missing)}; name one by hand: --attach {missing[0]}=BONE")
    return warnings
