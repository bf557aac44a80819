"""`cape info` and `cape clips`: what a clip holds, which clips there are."""

import json as jsonlib
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from itertools import groupby

import numpy as np

import motions
from cape.cli.character import Reading
from cape.cli.rows import print_rows
from cape.cuts import Cuts, seam
from cape.dress import dress
from cape.reach import reach_of
from cape.start import check_start
from motions.errors import UserError
from motions.roles import ROLES
from skeleton import Finding, Skeleton, check_motion

TOLD_OF_A_KIND = 3


def run(reading: Reading, *, json: bool = False) -> int:
    """Tell what a clip holds; gives the exit status."""
    clip = reading.load_as_is()
    body = reading.body(clip)
    findings = _findings(body, clip)
    root = clip.joints[0]
    facts = [
        ("clip", clip.name),
        ("motion", f"{clip.frames} frames at {clip.fps:g} fps, {clip.duration:.2f} s"),
        ("joints", f"{len(clip.joints)} and {len(clip.end_parents)} end sites, root {root!r}"),
        ("body", f"{body.height():.2f} m tall" if "head" in body.roles else "of unknown height"),
        *(("decided", decision) for decision in clip.decisions),
        *(("role", f"{role}: {body.roles[role]}") for role in ROLES if role in body.roles),
        ("capsules", ", ".join(c.name for c in body.capsules())),
        *(("left out", f"{name}: {reason}") for name, reason in body.capsules_left_out().items()),
        *_jump_rows(body, clip),
        *_cape_rows(body, clip),
        *(("check", text) for text in _told(findings)),
        *(("warning", text) for text in _warnings(clip, body.roles)),
        ("joint names", ", ".join(clip.joints)),
    ]
    if json:
        rows = [list(row) for row in facts if row[0] != "check"]
        print(jsonlib.dumps({"rows": rows, "findings": [asdict(finding) for finding in findings]}))
    else:
        print_rows(facts)
    return 0


def _findings(body: Skeleton, clip: motions.Clip) -> list[Finding]:
    """What deserves a look in the motion, and where a cape would start."""
    if clip.frames < 2:
        return []
    track = body.track(clip)
    findings = [*check_motion(track, body.capsules(), height=body.height() if "head" in body.roles else None)]
    with suppress(UserError):  # there is no cape then; `_cape_rows` tells why
        findings += check_start(dress(body, track), track)
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


def _jump_rows(body: Skeleton, clip: motions.Clip) -> list[tuple[str, str]]:
    """Tell where the bones jump, and whether they do where the clip begins again."""
    if clip.frames < 2:
        return []
    track, cuts, rows = body.track(clip), Cuts(), []
    holding = [role for role in ("left_shoulder", "right_shoulder") if role in body.roles]
    if jumps := cuts.frames(track, holding):
        rows.append(("jumps", f"the bones jump at frame {', '.join(map(str, jumps))}: a cape is carried along"))
    way = float(np.linalg.norm(track.positions[0] - track.positions[-1], axis=1).max())
    again = f"the first frame is up to {way:.2f} m from the last"
    if cuts.frames(seam(track), holding):
        rows.append(("loop", f"{again}, a jump: a cape is carried along"))
    else:
        rows.append(("loop", f"{again}, no jump"))
    return rows


def _cape_rows(body: Skeleton, clip: motions.Clip) -> list[tuple[str, str]]:
    """Tell what a cape would be and what it can't reach, or why there is none."""
    if clip.frames < 2:
        return []
    track = body.track(clip)
    try:
        scene = dress(body, track)
        reach = reach_of(scene, track)
    except UserError as error:
        return [("cape", f"none: {error}")]
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


def _warnings(clip: motions.Clip, roles: Mapping[str, str]) -> list[str]:
    missing = [role for role in ROLES if role not in roles and not role.endswith("hand")]
    warnings = []
    if clip.frames < 2:
        warnings.append("a single frame: no motion to replay")
    if missing:
        warnings.append(f"no bone found for {', '.join(missing)}; name one by hand: --attach {missing[0]}=BONE")
    return warnings
