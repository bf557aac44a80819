"""From what the command line names to a character that moves: its bones, its hitboxes, its looks."""

from dataclasses import dataclass
from pathlib import Path

from cape.cli.reading import MOST_FPS, Reading
from cape.kernels import store
from motions.errors import FileError, UserError
from motions.files import require_file
from motions.skin import Skin
from skeleton import (
    BoneTrack,
    Hitboxes,
    LinkSurface,
    Retargeted,
    Skeleton,
    hitboxes_of,
    kept_hitboxes_of,
    link_surfaces,
    load_hitboxes,
    missing_meshes,
    retarget,
)
from skeleton.rest import FRAME_ROLES, LEG_ROLES

FITTED = ("limbs", "all")
BY_PROPORTIONS = "body"


@dataclass(frozen=True, eq=False)
class Character:
    """Who moves, and how.

    Attributes:
        name: of the motion.
        body: the skeleton.
        track: the motion of all of its bones.
        hitboxes: solids around its limbs, and why there are no others.
        surfaces: what a robot looks like; none for the body of a clip.
        skin: the character's own mesh, where it came with the motion.
        retargeted: how well a robot follows a clip.
        decisions: what had to be decided, a sentence each.
    """

    name: str
    body: Skeleton
    track: BoneTrack
    hitboxes: Hitboxes
    surfaces: tuple[LinkSurface, ...] = ()
    skin: Skin | None = None
    retargeted: Retargeted | None = None
    decisions: tuple[str, ...] = ()


def read_character(reading: Reading, *, hitboxes: str | None = None) -> Character:
    """Read a motion, build who makes it, and put hitboxes around its limbs.

    Args:
        reading: what to read.
        hitboxes: "limbs" or "all" of what has a mesh, "body" for human proportions, or a TOML file; None for "limbs"
            where there is a robot or a character's own mesh, "body" where there is neither.

    Raises:
        UserError: a file can't be read, or things don't fit each other.
    """
    if reading.skeleton is None:
        clip = reading.load()
        body = reading.body(clip)
        solids = find_hitboxes(body, hitboxes or usual_hitboxes(body))
        return _character(clip.name, body, body.track(clip), solids, (*clip.decisions, *body.decisions))
    # A robot's meshes, and hitboxes fitted to them, take seconds: whatever is wrong with the motion is told before.
    if (path := reading.configuration_file) is not None:
        require_file(path)
        robot = reading.robot(reading.skeleton)
        motion, retargeted, before = reading.configurations(path, robot), None, ()
        solids = find_hitboxes(robot, hitboxes or "limbs")
    else:
        clip = reading.load()
        robot = reading.robot(reading.skeleton)
        robot.require_roles(("pelvis", *FRAME_ROLES, *LEG_ROLES))
        solids = find_hitboxes(robot, hitboxes or "limbs")
        retargeted = retarget(clip, robot, hitboxes=solids)
        motion, before = retargeted.motion, clip.decisions
    track = robot.track(motion)
    fps = reading.frame_rate or min(track.fps, MOST_FPS)
    # A frame rate is a quotient of times, so that 60 may come out a hair above it.
    track = track if abs(fps - track.fps) < 1e-6 * fps else track.resample(fps)
    decisions = (*robot.decisions, *before, *motion.decisions)
    return _character(motion.name, robot, track, solids, decisions, retargeted)


def _character(
    name: str,
    body: Skeleton,
    track: BoneTrack,
    hitboxes: Hitboxes,
    decisions: tuple[str, ...],
    retargeted: Retargeted | None = None,
) -> Character:
    surfaces: tuple[LinkSurface, ...] = ()
    if body.is_robot:
        try:
            surfaces = link_surfaces(body, "visual")
            decisions = (*decisions, *missing_meshes(body, "visual"))
        except FileError as error:
            decisions = (*decisions, f"not drawn: {error}")
    return Character(name, body, track, hitboxes, surfaces, body.skin, retargeted, (*decisions, *hitboxes.decisions))


def usual_hitboxes(body: Skeleton) -> str:
    """How hitboxes are made where nothing is asked for: fitted to a mesh, where there is one."""
    return "limbs" if body.is_robot or body.skin is not None else BY_PROPORTIONS


def find_hitboxes(body: Skeleton, asked: str) -> Hitboxes:
    """Solids around a body's limbs, as asked on the command line.

    Raises:
        UserError: there is no such way to make them, or it doesn't suit the body.
    """
    require_hitboxes(asked)
    if asked == BY_PROPORTIONS:
        return Hitboxes(body.name, body.capsules(), body.capsules_left_out())
    if asked in FITTED:
        if not body.is_robot and body.skin is None:
            raise UserError(
                f"--hitboxes {asked} needs a robot, whose links have surfaces: name it by --skeleton, or take a GLB"
            )
        which = "all" if asked == "all" else "limbs"
        place = store.folder()
        return hitboxes_of(body, which=which) if place is None else kept_hitboxes_of(body, place, which=which)
    return load_hitboxes(asked, body)


def require_hitboxes(asked: str) -> None:
    """Check that there is such a way to make hitboxes, whomever they are for.

    Raises:
        UserError: there is none, or no such file.
    """
    if asked in (*FITTED, BY_PROPORTIONS):
        return
    if not asked.lower().endswith(".toml"):
        ways = ", ".join((*FITTED, BY_PROPORTIONS))
        raise UserError(f"no way to make hitboxes named {asked!r}; available: {ways}, or a TOML file of them")
    require_file(Path(asked))
