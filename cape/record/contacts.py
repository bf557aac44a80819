"""The contacts of a recording: where the cloth touches colliders, in which direction, and how deep."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from cape.measure.contact_points import ContactPoints
from cape.record.frames import Frames, send_once
from cape.results.kept import let_go
from cape.scene.colliders import Collider

if TYPE_CHECKING:
    import rerun as rr

POINT_SIZE = 3.5  # [points of the screen], so that none is overlooked from afar
ARROW_LENGTH, ARROW_RADIUS = 0.05, 0.0015  # [m]
ARROW_COLOR = (235, 235, 235)
TOUCHING_COLOR, PRESSED_COLOR, INSIDE_COLOR = (60, 220, 110), (255, 215, 60), (255, 40, 70)
BYTES_PER_CONTACT = 42  # in the recording
OTHERS = 2**16 - 1  # the last class that Rerun has a number for: of all colliders from there on


def log_contacts(
    stream: rr.RecordingStream,
    contacts: ContactPoints,
    colliders: Sequence[Collider],
    thicknesses: NDArray[np.float64],
    frames: Frames,
    *,
    path: str = "/world/contacts",
) -> None:
    """Put points on `/points` below the path, their class the collider up to `OTHERS`, and normals on `/normals`."""
    import rerun as rr

    if frames.begins:
        names = [rr.AnnotationInfo(id=k, label=collider.name) for k, collider in enumerate(colliders[:OTHERS])]
        if len(colliders) > OTHERS:
            names.append(rr.AnnotationInfo(id=OTHERS, label="another collider"))
        send_once(stream, path, rr.AnnotationContext(names))
        points = rr.Points3D.from_fields(radii=rr.Radius.ui_points(POINT_SIZE), show_labels=False)
        send_once(stream, f"{path}/points", points)
        arrows = rr.Arrows3D.from_fields(radii=ARROW_RADIUS, colors=ARROW_COLOR, show_labels=False)
        send_once(stream, f"{path}/normals", arrows)
    size = BYTES_PER_CONTACT * int(contacts.counts.max(initial=0))
    for block in frames.blocks(size):
        some = contacts.select(frames.numbers[block])
        colors = depth_colors(some.depths, thicknesses[some.colliders])
        points = {
            "positions": some.points,
            "colors": colors,
            "class_ids": np.minimum(some.colliders, OTHERS).astype(np.uint16),
        }
        frames.send(stream, f"{path}/points", rr.Points3D, points, block=block, counts=some.counts)
        normals = {"origins": some.points, "vectors": ARROW_LENGTH * some.normals}
        frames.send(stream, f"{path}/normals", rr.Arrows3D, normals, block=block, counts=some.counts)
        for array in (contacts.points, contacts.normals, contacts.depths, contacts.colliders, contacts.vertices):
            let_go(array)


def depth_colors(depths: NDArray[np.float32], thicknesses: NDArray[np.float64]) -> NDArray[np.uint8]:
    """From green at the outside of the thickness to yellow at the collider's surface, and red inside it, (n, 3).

    `depths` in the thickness and the `thicknesses` themselves in metres, shape (n,).
    """
    share = np.clip(depths / np.maximum(thicknesses, 1e-9), 0.0, 1.0)[:, None]
    colors = (1.0 - share) * TOUCHING_COLOR + share * np.array(PRESSED_COLOR)
    return np.where((depths > thicknesses)[:, None], INSIDE_COLOR, np.rint(colors)).astype(np.uint8)
