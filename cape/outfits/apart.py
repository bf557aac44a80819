"""The take of an outfit as takes of its parts, each with its own vertices and triangles, as it may have torn."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cape.assembly.springs import springs_of
from cape.measure.contact_points import ContactPoints
from cape.outfits.combined import Outfit, Part, as_mesh
from cape.results.take import Take
from cape.results.topology import Topology, most_split

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


def takes_apart(take: Take) -> list[Take]:
    """The takes of an outfit's parts, the outermost first; of any other cloth the take itself.

    Stretch is each part's own; penetration, energy, tears and mass are those of the outfit.
    """
    if not isinstance(take.cloth, Outfit):
        return [take]
    return [_of_part(take, part, take.cloth) for part in reversed(take.cloth.parts)]


def _of_part(take: Take, part: Part, outfit: Outfit) -> Take:
    topologies = take.topologies or (Topology(0, take.triangles, np.arange(outfit.vertices)),)
    parents = most_split(topologies).parents
    own = (parents >= part.vertices.start) & (parents < part.vertices.stop)
    number = np.where(own, np.cumsum(own) - 1, -1)
    first = sum(len(before.cloth.triangles) for before in outfit.parts if before.start < part.start)
    faces = slice(first, first + len(part.cloth.triangles))
    torn = _changes([_topology_of(part, each, faces, own, number) for each in topologies])
    positions = take.positions[:, own]
    return replace(
        take,
        name=part.name,
        triangles=torn[0].triangles,
        texcoords=part.cloth.texcoords[most_split(torn).parents],
        positions=positions,
        stretch_max=_stretch(part, positions, torn),
        held=number[take.held[own[take.held]]],
        contacts=None if take.contacts is None else _contacts_of(take.contacts, own, number),
        topologies=torn if take.topologies else (),
        cloth=part.cloth,
    )


def _topology_of(part: Part, all_of: Topology, faces: slice, own: NDArray[np.bool_], number: IntArray) -> Topology:
    """That of the vertices that are a part's `own`, by the `number` of each in the part."""
    parents = all_of.parents[own[: len(all_of.parents)]] - part.start
    return Topology(all_of.frame, number[all_of.triangles[faces]].astype(np.int32), parents)


def _changes(topologies: list[Topology]) -> tuple[Topology, ...]:
    """Those that are not as the one before."""
    return tuple(t for k, t in enumerate(topologies) if k == 0 or not t.is_as(topologies[k - 1]))


def _stretch(part: Part, positions: NDArray[np.float32], torn: tuple[Topology, ...]) -> FloatArray:
    """The largest strain of what stretch is measured on in each frame, sides of triangles, shape (F,)."""
    whole, springs = part.cloth.triangles.astype(np.int64), springs_of(as_mesh(part.cloth))
    ends = np.sort(np.stack([whole, np.roll(whole, -1, axis=1)], axis=2).reshape(-1, 2), axis=1)
    count = part.cloth.vertices
    keys = np.sort(np.stack([springs.first, springs.second], axis=1)[springs.measured], axis=1) @ [count, 1]
    order, wanted = np.argsort(keys), ends @ [count, 1]
    place = order[np.minimum(np.searchsorted(keys, wanted, sorter=order), len(keys) - 1)]
    sides = np.flatnonzero(keys[place] == wanted)
    rest = springs.rest[springs.measured][place[sides]]
    strain = []
    for topology, end in zip(torn, [*(t.frame for t in torn[1:]), len(positions)], strict=True):
        now = topology.triangles
        pairs = np.stack([now, np.roll(now, -1, axis=1)], axis=2).reshape(-1, 2)[sides]
        for frame in positions[topology.frame : end].astype(float):
            lengths = np.linalg.norm(frame[pairs[:, 0]] - frame[pairs[:, 1]], axis=1)
            strain.append((lengths / rest - 1.0).max())
    return np.maximum(strain, 0.0)


def _contacts_of(contacts: ContactPoints, own: NDArray[np.bool_], number: IntArray) -> ContactPoints:
    there = own[contacts.vertices]
    before = np.concatenate([[0], np.cumsum(there)])
    return ContactPoints(
        before[contacts.starts],
        contacts.points[there],
        contacts.normals[there],
        contacts.depths[there],
        contacts.colliders[there],
        number[contacts.vertices[there]].astype(contacts.vertices.dtype),
    )
