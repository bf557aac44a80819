"""What a user should look at after a run, a sentence each."""

import numpy as np
from numpy.typing import NDArray

from cape.assembly.self_contact import connected_pieces
from cape.results.take import Take
from cape.results.topology import Topology

FloatArray = NDArray[np.float64]

NOTABLE_PENETRATION = 0.005  # m
NOTABLE_STRETCH = 0.1
STUCK_DEPTH = 0.001  # m; a vertex that rests on a collider without thickness is in it by less
STUCK_FRAMES = 10  # in a row
NAMED_VERTICES = 5
NEARBY_FRAMES = 10  # in which what stretches a cloth is looked for
FAST = 15.0  # m/s of a bone: faster than a sprinter's foot swings in all but records
MOSTLY = 0.5  # of a cape that is off: the rest is what bones have kept


def warnings_of(take: Take) -> list[str]:
    """All that is worth a look in a take."""
    return [
        *penetration_warnings(take),
        *stuck_warnings(take),
        *reach_warnings(take),
        *stretch_warnings(take),
        *loose_warnings(take),
    ]


def penetration_warnings(take: Take) -> list[str]:
    """Name the colliders that vertices went notably deep into, when, how deep, and for how long."""
    depths, which = take.penetration, take.penetrated
    notable = depths > NOTABLE_PENETRATION
    warnings = []
    for index in np.unique(which[notable]):
        frames = np.flatnonzero(notable & (which == index))
        worst = int(frames[depths[frames].argmax()])
        warnings.append(
            f"the cloth enters {take.colliders[index].name} by up to {1000 * depths[worst]:.1f} mm at frame {worst}, "
            f"{_for_frames(frames)}: limbs that pass through each other leave it no place"
        )
    return warnings


def stuck_warnings(take: Take) -> list[str]:
    """Name the vertices that stay inside a collider for more than `STUCK_FRAMES` frames in a row."""
    contacts = take.contacts
    if contacts is None:
        return []
    depths = contacts.depths - take.thicknesses[contacts.colliders]
    inside = depths > STUCK_DEPTH
    frames, colliders, vertices, depths = (
        values[inside] for values in (contacts.frames, contacts.colliders, contacts.vertices, depths)
    )
    warnings = []
    for index in np.unique(colliders):
        chosen = np.flatnonzero(colliders == index)
        chosen = chosen[np.lexsort((frames[chosen], vertices[chosen]))]
        breaks = (np.diff(vertices[chosen]) != 0) | (np.diff(frames[chosen]) != 1)
        stays = [stay for stay in np.split(chosen, np.flatnonzero(breaks) + 1) if len(stay) > STUCK_FRAMES]
        if not stays:
            continue
        longest = max(stays, key=len)
        worst = max(stays, key=lambda stay: depths[stay].max())
        deepest = worst[depths[worst].argmax()]
        named = sorted({int(vertices[stay[0]]) for stay in stays})
        more = f" and {len(named) - NAMED_VERTICES} more" if len(named) > NAMED_VERTICES else ""
        warnings.append(
            f"stuck in {take.colliders[index].name}: vertices {', '.join(map(str, named[:NAMED_VERTICES]))}{more} stay "
            f"inside for up to {len(longest)} frames from frame {frames[longest[0]]} on, and up to "
            f"{1000 * depths[deepest]:.1f} mm deep (vertex {vertices[deepest]} at frame {frames[deepest]})"
        )
    return warnings


def reach_warnings(take: Take) -> list[str]:
    """Name the colliders that the cloth came to although they had been left out as beyond its reach."""
    if take.contacts is None:
        return []
    warnings = []
    for index, collider in enumerate(take.colliders):
        met = np.flatnonzero(take.contacts.colliders == index)
        if collider.name in take.left_out and len(met):
            frame = int(take.contacts.frames[met[0]])
            warnings.append(
                f"the cloth stretches as far as {collider.name} at frame {frame}, which was left out as beyond its "
                "reach: it may have passed through before"
            )
    return warnings


def stretch_warnings(take: Take) -> list[str]:
    """Tell of notable stretch, and what brought it about."""
    strains = take.stretch_max
    worst, frames = int(strains.argmax()), int((strains > NOTABLE_STRETCH).sum())
    if frames == 0:
        return []
    return [
        f"the cloth stretches by up to {strains[worst]:.0%} at frame {worst}, for {frames} frames: "
        f"{_cause_of_stretch(take, worst)}"
    ]


def _cause_of_stretch(take: Take, frame: int) -> str:
    """What most likely drew the cloth out at a frame, and what helps."""
    around = slice(max(frame - NEARBY_FRAMES, 0), frame + NEARBY_FRAMES + 1)
    jumps = [jump for jump in take.jumps if around.start <= jump <= frame]
    if jumps and jumps[-1] not in take.renewed:
        return f"it was carried along as the bones jumped at frame {jumps[-1]}; --cuts reset puts it on anew there"
    if len(places := take.bones.positions[around]) > 1:
        ways = np.linalg.norm(np.diff(places, axis=0), axis=2).max(axis=1)
        fastest = float((ways / np.diff(take.bones.times[around])).max())
        if fastest > FAST:
            return f"bones move at {fastest:.0f} m/s there: look whether the motion's unit and frame rate are right"
    if take.penetration[around].max() > STUCK_DEPTH:
        return "limbs that pass through each other hold it fast"
    if take.solver == "xpbd":
        return "more substeps, or a stiffer fabric, hold it better"
    return "look whether something holds it fast; a stiffer fabric stretches less"


def loose_warnings(take: Take) -> list[str]:
    """Tell when a cloth that bones hold has torn so far that a part of it, or all, hangs on nothing."""
    if take.tears == 0 or not len(take.held):
        return []
    loose = [(topology.frame, _share_loose(topology, take.held)) for topology in take.topologies]
    most = max(share for _, share in loose)
    first = next((frame for frame, share in loose if share > 0.0), 0)
    if most > MOSTLY:
        first = next(frame for frame, share in loose if share > MOSTLY)
        return [f"the cape comes off at frame {first}: {most:.0%} of it hang on nothing in the end"]
    return [f"{most:.1%} of the cape come off, the first at frame {first}"] if most > 0.0 else []


def _share_loose(topology: Topology, held: NDArray[np.int64]) -> float:
    """Share of triangles in pieces that no bone holds."""
    pieces = connected_pieces(topology.triangles, len(topology.parents))
    return float((~np.isin(pieces[topology.triangles[:, 0]], pieces[held])).mean())


def _for_frames(frames: NDArray[np.int64]) -> str:
    """How often and when."""
    if len(frames) == 1:
        return "for 1 frame"
    runs = 1 + int((np.diff(frames) > 1).sum())
    span = f"for {len(frames)} frames from {frames[0]} to {frames[-1]}"
    return span if runs == 1 else f"{span}, {runs} times"
