"""A character's own mesh, which its bones move: its vertices are sent frame by frame, all else once."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from cape.cloth.drawn.textures import decoded
from cape.cloth.normals import vertex_normals
from cape.record.figure.body import BODY_COLOR
from cape.record.frames import Frames, send_once
from cape.record.surfaces.light import srgb
from cape.record.surfaces.textures import albedo
from motions.errors import FileError
from motions.skin import Skin, SkinPiece
from skeleton.track import BoneTrack

if TYPE_CHECKING:
    import rerun as rr

SEEN_THROUGH = 0.5  # opacity under which a piece, such as a shadow or a lens, would hide what it shows


def log_skin(stream: rr.RecordingStream, bones: BoneTrack, skin: Skin, frames: Frames) -> None:
    """Put each piece of the mesh on `/world/body/<piece>`, in the world."""
    import rerun as rr

    at, morphs = [bones.index(bone) for bone in skin.bones], morphs_of(bones, skin)
    for piece in skin.pieces:
        path = rr.new_entity_path(["world", "body", piece.name])
        if frames.begins:
            send_once(
                stream, path, rr.Mesh3D.from_fields(triangle_indices=piece.triangles.astype(np.uint32), **look(piece))
            )
        for block in frames.blocks(2 * 12 * len(piece.vertices)):
            numbers = frames.numbers[block]
            weights = None if morphs is None else morphs[numbers]
            places, turns = bones.positions[numbers][:, at], bones.rotations_wxyz[numbers][:, at]
            poses = skin.posed(piece, places, turns, morphs=weights)
            places, normals = zip(*poses, strict=True)
            vertices = np.stack(places)
            shaded = vertex_normals(vertices, piece.triangles) if piece.normals is None else np.stack(normals)
            frames.send(stream, path, rr.Mesh3D, {"vertex_positions": vertices, "vertex_normals": shaded}, block=block)


def look(piece: SkinPiece) -> dict[str, Any]:
    """The components of a mesh that give a piece its colour: of its texture, times that of its material."""
    if piece.rgba is None:
        return {"albedo_factor": BODY_COLOR}
    tint = [*srgb(piece.rgba[:3]), 1.0 if piece.rgba[3] > SEEN_THROUGH else piece.rgba[3]]
    found: dict[str, Any] = {"albedo_factor": np.rint(255.0 * np.array(tint)).astype(np.uint8)}
    if piece.image is not None and piece.texcoords is not None:
        try:
            found |= albedo(decoded(piece.image, f"the texture of {piece.name}"))
            found["vertex_texcoords"] = piece.texcoords.astype(np.float32)
        except FileError:
            pass  # drawn in its plain colour
    return found


def morphs_of(bones: BoneTrack, skin: Skin) -> NDArray[np.float64] | None:
    """Weights of a skin's morphs over a track, shape (F, M); None where that tells none of this skin.

    A skin that was read again is no other one.
    """
    return bones.morphs if bones.skin is not None and _morphed(bones.skin) == _morphed(skin) else None


def _morphed(skin: Skin) -> list[tuple[str, int, list[int]]]:
    """Name, number of vertices and morphs of each piece, by which skins are told apart."""
    return [
        (piece.name, len(piece.vertices), [] if piece.target_morphs is None else piece.target_morphs.tolist())
        for piece in skin.pieces
    ]


def skin_height(bones: BoneTrack, skin: Skin, frame: int) -> float:
    """From the lowest to the highest vertex in a frame [m]."""
    at = [bones.index(bone) for bone in skin.bones]
    where = bones.positions[[frame]][:, at], bones.rotations_wxyz[[frame]][:, at]
    heights = [next(skin.posed(piece, *where))[0][:, 2] for piece in skin.pieces]
    return float(np.ptp(np.concatenate(heights)))
