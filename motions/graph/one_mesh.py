"""The mesh that clips of one character have in common, and the morph targets that any of them moves.

A clip's skin holds the targets alone that its own file moves. Here those of all are one list, so that a character goes
on talking in the next clip, or closes its mouth.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from motions.clip import Clip
from motions.skin import Skin, SkinPiece

FloatArray = NDArray[np.float64]

SHAPE = ("vertices", "triangles", "binds", "weights")  # of a piece, by which meshes are told apart
_Target = tuple[FloatArray, FloatArray | None]


@dataclass(frozen=True, eq=False)
class OneMesh:
    """A mesh with all M morphs of some clips.

    Attributes:
        skin: the first clip's that has a mesh; None where none has.
        weights: of its morphs in each clip, which are 0 where that moves none of them, shape (F, M) each.
        own: whether each clip has this mesh.
        lost: names of clips whose morphs don't move, since their mesh is another one.
    """

    skin: Skin | None
    weights: tuple[FloatArray, ...]
    own: tuple[bool, ...]
    lost: tuple[str, ...]


def one_mesh(clips: Sequence[Clip]) -> OneMesh:
    """Find the mesh of some clips, and give all their morphs one numbering."""
    first = next((clip.skin for clip in clips if clip.skin is not None), None)
    if first is None:
        return OneMesh(None, tuple(np.zeros((clip.frames, 0)) for clip in clips), (False,) * len(clips), ())
    morphs = _targets(first)
    own = tuple(clip.skin is not None and _is_same(clip.skin, first) for clip in clips)
    numbers = [
        _numbers(clip.skin, first, morphs) if here and clip.skin is not None and clip.morphs is not None else None
        for clip, here in zip(clips, own, strict=True)
    ]
    weights = []
    for clip, places in zip(clips, numbers, strict=True):
        weights.append(np.zeros((clip.frames, len(morphs))))
        if places is not None:
            weights[-1][:, places] = clip.morphs
    lost = tuple(clip.name for clip, here in zip(clips, own, strict=True) if clip.morphs is not None and not here)
    skin = first if len(morphs) == first.morphs else _with_targets(first, morphs)
    return OneMesh(skin, tuple(weights), own, lost)


def _is_same(skin: Skin, other: Skin) -> bool:
    """Tell whether two skins are the same but for what their morphs are."""
    if skin is other:
        return True
    if skin.bones != other.bones or len(skin.pieces) != len(other.pieces) or not np.allclose(skin.binds, other.binds):
        return False
    return all(
        np.array_equal(getattr(piece, name), getattr(its, name))
        for piece, its in zip(skin.pieces, other.pieces, strict=True)
        for name in SHAPE
    )


def _targets(skin: Skin) -> list[dict[int, _Target]]:
    """Of each morph, how far it moves vertices and normals of which pieces, by the piece's number."""
    found: list[dict[int, _Target]] = [{} for _ in range(skin.morphs)]
    for number, piece in enumerate(skin.pieces):
        if piece.targets is not None and piece.target_morphs is not None:
            for k, morph in enumerate(piece.target_morphs):
                found[morph][number] = (
                    piece.targets[k],
                    None if piece.normal_targets is None else piece.normal_targets[k],
                )
    return found


def _numbers(skin: Skin, first: Skin, morphs: list[dict[int, _Target]]) -> list[int]:
    """Which of the morphs each of a skin's is, that moves the same vertices just so; what is not there is added."""
    if skin is first:
        return list(range(skin.morphs))
    found: list[int] = []
    for targets in _targets(skin):
        same = (
            number
            for number, known in enumerate(morphs)
            if number not in found
            and known.keys() == targets.keys()
            and all(np.array_equal(known[k][0], targets[k][0]) for k in known)
        )
        found.append(next(same, len(morphs)))
        if found[-1] == len(morphs):
            morphs.append(targets)
    return found


def _with_targets(skin: Skin, morphs: Sequence[dict[int, _Target]]) -> Skin:
    return replace(skin, pieces=tuple(_piece_with(piece, k, morphs) for k, piece in enumerate(skin.pieces)))


def _piece_with(piece: SkinPiece, number: int, morphs: Sequence[dict[int, _Target]]) -> SkinPiece:
    mine = [k for k, targets in enumerate(morphs) if number in targets]
    if not mine:
        return piece
    moves, turns = zip(*(morphs[k][number] for k in mine), strict=True)
    still = np.zeros_like(piece.vertices)
    turned = None
    if piece.normals is not None and any(each is not None for each in turns):
        turned = np.stack([still if each is None else each for each in turns])
    return replace(piece, targets=np.stack(moves), normal_targets=turned, target_morphs=np.array(mine))
