"""`cape hitboxes`: what a cape meets, to a recording: colliders, their shells, and the contacts of each frame."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from cape import record
from cape.cli.character import Character, read_character
from cape.cli.exports.writing import RECORDED
from cape.cli.figures.rows import print_rows
from cape.cli.output import open_viewer, output_path, require_suffix
from cape.cli.reading import Reading
from cape.cli.running import RECORDER, simulated
from cape.cli.words import gathered
from cape.reach import Reach, reach_of
from cape.results.take import Take
from cape.scene.colliders import Collider
from cape.scene.dress import dress
from cape.scene.scene import Scene
from motions.errors import UserError


def run(
    reading: Reading, *, output: Path | None, hitboxes: str | None, write: Path | None, bare: bool, spawn: bool
) -> int:
    """Record the colliders, and how a cape meets them unless `bare`; gives the exit status."""
    record.require_recorder()
    inputs = (*reading.files, hitboxes)
    for file, suffix in ((output, RECORDED), (write, ".toml")):
        if file is not None:
            require_suffix(output_path(file, "", inputs=inputs), (suffix,))
    who = read_character(reading, hitboxes=hitboxes)
    path = output_path(output, who.name, "_hitboxes.rrd", inputs=inputs)
    if write is not None:
        who.hitboxes.save(output_path(write, who.name, ".toml", inputs=inputs))
    missing = [(name, f"left out: {reason}") for name, reason in who.hitboxes.left_out.items()]
    status = 0
    if bare:
        colliders, reach, notes = _bare(who)
        left_out = {} if reach is None else reach.left_out
        record.save_hitboxes(
            who.track,
            colliders,
            path,
            name=f"{who.name} hitboxes",
            surfaces=who.surfaces,
            skin=who.skin,
            left_out=left_out,
        )
        rows = [(c.name, _text(c, reach)) for c in colliders]
    else:
        scene = dress(who.body, who.track, colliders=who.hitboxes.solids)
        reach = reach_of(scene, who.track)
        take = simulated(scene, who, modules=RECORDER)
        record.save(take, path, surfaces=who.surfaces, skin=who.skin, tab="hitboxes")
        touched = _touched(take)
        rows = [(c.name, f"{_text(c, reach)}; {touched[c.name]}") for c in take.colliders]
        notes = [("result", take.result), *(("", warning) for warning in gathered(take.warnings))]
        status = 130 if take.result.startswith("stopped") else 0
    print_rows([*rows, *missing, *_fit_rows(who), *notes, ("recording", str(path))])
    if spawn:
        open_viewer(path)
    return status


def _fit_rows(who: Character) -> list[tuple[str, str]]:
    """How well solids that were fitted to a robot's links hold them."""
    return [
        (
            "fit",
            f"{link}: {fit.outside:.1%} of its {fit.geometry} surface sticks out of {', '.join(fit.solids)}, by "
            f"{1000 * fit.p99:.1f} mm in all but 1 %, {1000 * fit.most:.1f} mm at most; "
            f"{fit.volume_ratio:.2f} times the volume of its hull",
        )
        for link, fit in who.hitboxes.qualities.items()
    ]


def _bare(who: Character) -> tuple[Sequence[Collider], Reach | None, list[tuple[str, str]]]:
    """Colliders and what of them a cape could reach, None and a note for a body that none can be cut for."""
    try:
        scene = dress(who.body, who.track, colliders=who.hitboxes.solids)
        return scene.colliders, reach_of(scene, who.track), []
    except UserError as error:
        return who.hitboxes.solids, None, [("reach", f"unknown: {error}")]


def _text(collider: Collider, reach: Reach | None) -> str:
    """What a collider is, how thick, and whether a cape can reach it."""
    thickness = Scene.thickness if collider.thickness is None else collider.thickness
    carrier = "that stands still" if collider.bone is None else f"on {collider.bone}"
    text = f"{collider.describe()} {carrier}, thickness {1000 * thickness:g} mm"
    if reach is None:
        return text
    kept = reach.kept.get(collider.name)
    return f"{text}; " + (f"left out: {reach.left_out[collider.name]}" if kept is None else f"kept: {kept}")


def _touched(take: Take) -> dict[str, str]:
    """For each collider when, and how deep into its thickness, the cloth touches it."""
    contacts, texts = take.contacts, {}
    for index, collider in enumerate(take.colliders):
        chosen = np.zeros(0, dtype=np.int64) if contacts is None else np.flatnonzero(contacts.colliders == index)
        if contacts is None or not len(chosen):
            texts[collider.name] = "never touched"
            continue
        frames, counts = np.unique(contacts.frames[chosen], return_counts=True)
        texts[collider.name] = (
            f"touched in {len(frames)} frames from {frames[0]} on, by {counts.max()} vertices at most, "
            f"up to {1000 * contacts.depths[chosen].max():.1f} mm into the thickness"
        )
    return texts
