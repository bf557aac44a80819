"""From what a command line asks for to what is simulated: a character in its garment, or a scene with a name."""

import inspect
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING

from cape.air.wind import Wind
from cape.cli.character import read_character
from cape.cli.reading import Reading
from cape.scene.scene import Scene
from cape.scene.self_contact import SelfContact
from cape.scenes.registry import NamedScene
from motions.errors import UserError, ValueRangeError
from motions.skin import Skin
from skeleton import BoneTrack, LinkSurface, Retargeted

if TYPE_CHECKING:
    from cape.cli.commands.replay import Cut

MOVING = ("end", "fps")  # of a motion's options those that go for any motion
WEARING = {
    "garments": "garment",
    "fabrics": "the garments of fabrics",
    "length": "length",
    "hold": "hold",
    "mesh": "cloth",
}  # fields and options that go for characters alone


@dataclass(frozen=True, eq=False)
class Staged:
    """What is simulated, and what else there is to see.

    Attributes:
        name: of the motion.
        track: the bones.
        scene: cloth and all that it meets.
        surfaces: what a robot looks like.
        skin: what a character with a mesh of its own looks like.
        retargeted: how well a robot follows a clip.
        decisions: what had to be decided, a sentence each.
    """

    name: str
    track: BoneTrack
    scene: Scene
    surfaces: tuple[LinkSurface, ...] = ()
    skin: Skin | None = None
    retargeted: Retargeted | None = None
    decisions: tuple[str, ...] = ()


def staged(reading: Reading, cut: "Cut", *, scene: NamedScene | None = None, hitboxes: str | None = None) -> Staged:
    """Build what is to be simulated.

    Args:
        reading: the motion and who makes it.
        cut: what is worn, and how to simulate it.
        scene: a scene of its own cloth, in place of a character; one that stands for options is told by these.
        hitboxes: as of `read_character`.

    Raises:
        UserError: something can't be read, is out of range, or does not go with the scene.
    """
    if scene is not None and scene.make is not None:
        return _on_stage(scene, reading, cut, hitboxes)
    who = read_character(reading, hitboxes=hitboxes)
    return Staged(who.name, who.track, cut.scene(who), who.surfaces, who.skin, who.retargeted, who.decisions)


def _on_stage(named: NamedScene, reading: Reading, cut: "Cut", hitboxes: str | None) -> Staged:
    """A scene of its own cloth, as far as options change it."""
    if named.make is None:
        raise TypeError(f"the scene {named.name} stands for options")
    usual = type(cut)()
    wrong = [f.name for f in fields(Reading) if f.name not in MOVING and getattr(reading, f.name)]
    wrong += [option for name, option in WEARING.items() if getattr(cut, name) != getattr(usual, name)]
    if wrong or hitboxes is not None:
        raise UserError(f"the scene {named.name} has no character: leave out {(wrong or ['hitboxes'])[0]}")
    if cut.spacing is not None and "spacing" not in inspect.signature(named.make).parameters:
        raise UserError(f"the scene {named.name} has a cloth of one spacing: leave out --spacing")
    standard = named.make() if cut.spacing is None else named.make(spacing=cut.spacing)
    scene, track = standard.scene, standard.track
    if cut.fabric != usual.fabric:
        scene = replace(scene, cloth=replace(scene.cloth, fabric=cut.cloth_fabric()))
    if cut.air() != Wind():
        scene = replace(scene, wind=cut.air())
    if cut.self_contact is not None:
        scene = replace(scene, self_contact=SelfContact() if cut.self_contact else None)
    if (tearing := cut.tearing()) is not None:
        scene = replace(scene, strain_limit=False, tearing=tearing)
    if cut.strain_limit is not None:
        scene = replace(scene, strain_limit=cut.strain_limit)
    return Staged(standard.name, _until(track, reading), scene)


def _until(track: BoneTrack, reading: Reading) -> BoneTrack:
    """A motion up to the end that was asked for, at the frame rate that was.

    Raises:
        ValueRangeError: nothing is left.
    """
    if reading.end is not None:
        frames = int((track.times - track.times[0] <= reading.end + 1e-9).sum())
        if frames < 2:
            raise ValueRangeError(f"end: {reading.end:g} s leaves less than two frames")
        track = track.first(frames)
    return track if reading.frame_rate is None else track.resample(reading.frame_rate)
