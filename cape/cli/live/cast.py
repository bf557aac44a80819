"""Who moves in a live run: a character that is steered, a motion that is played over and over, or a scene's bones."""

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from cape.cli.character import Character, read_character
from cape.cli.reading import MOST_FPS, Reading
from cape.cli.staging import staged
from cape.live.character import CharacterSource
from cape.live.sources import Source, TrackSource
from cape.scene.scene import Scene
from cape.scenes.registry import NamedScene
from motions import clip_names, load
from motions.clip import Clip
from motions.errors import UserError
from motions.graph.one_skeleton import check_one_skeleton
from motions.skin import Skin
from skeleton import LinkSurface

if TYPE_CHECKING:
    from cape.cli.commands.replay import Cut

GAITS = ("idle", "walk", "run")  # shipped clips that go round, from slow to fast


@dataclass(frozen=True, eq=False)
class Cast:
    """What is simulated live.

    Attributes:
        name: what it is called.
        scene: cloth and all that it meets.
        source: where the bones are.
        character: the same, where it can be steered.
        surfaces: what a robot looks like.
        skin: what a character with a mesh of its own looks like.
        decisions: what had to be decided, a sentence each.
    """

    name: str
    scene: Scene
    source: Source
    character: CharacterSource | None = None
    surfaces: tuple[LinkSurface, ...] = ()
    skin: Skin | None = None
    decisions: tuple[str, ...] = ()


def cast(reading: Reading, cut: "Cut", *, scene: NamedScene | None, hitboxes: str | None) -> Cast:
    """Build what is asked for; without any clip, a character that is steered through those that come along.

    Raises:
        UserError: something can't be read, is out of range, or does not go with the rest.
    """
    if scene is not None and scene.make is not None:
        who = staged(reading, cut, scene=scene, hitboxes=hitboxes)
        return Cast(scene.name, who.scene, TrackSource(who.track), decisions=who.decisions)
    asked = reading.clip
    shipped = asked in clip_names()
    if reading.script is None and reading.skeleton is None and (asked is None or shipped):
        reading = replace(reading, clip="idle")
    who = read_character(reading, hitboxes=hitboxes)
    if reading.skeleton is not None or reading.script is not None or reading.configuration_file is not None:
        return _cast(who, cut.scene(who), TrackSource(who.track))
    clips = _clips(reading)
    once = tuple(c.name for c in clips if c.name in clip_names() and c.name not in GAITS)
    source: Source = TrackSource(who.track)
    with suppress(UserError):  # too short to go round, or to be left
        source = CharacterSource(clips, who.body, clips[0].name, once=once)
        if shipped and asked is not None:
            source.go(asked)
    return _cast(who, cut.scene(who), source)


def _cast(who: Character, scene: Scene, source: Source) -> Cast:
    steered = source if isinstance(source, CharacterSource) else None
    return Cast(who.name, scene, source, steered, who.surfaces, who.skin, who.decisions)


def _clips(reading: Reading) -> list[Clip]:
    """The clip that is asked for, and those that come along if they move the same body."""
    asked = reading.load()
    whole = reading.start is None and reading.end is None
    if not whole:
        return [asked]
    fps = reading.frame_rate or min(asked.fps, MOST_FPS)
    others = [load(name, height=reading.height) for name in clip_names() if name != asked.name]
    others = [clip if clip.fps == fps else clip.resample(fps) for clip in others]
    return [asked, *others] if _alike(asked, others) else [asked]


def _alike(clip: Clip, others: list[Clip]) -> bool:
    try:
        check_one_skeleton([clip, *others])
    except UserError:
        return False
    return True
