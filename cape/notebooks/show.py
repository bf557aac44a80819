"""A take as the output of a notebook's cell."""

from __future__ import annotations

import uuid
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from cape.record.write import recording_of
from motions.errors import UserError
from motions.skin import Skin
from skeleton.robot.meshes.link_surfaces import LinkSurface

if TYPE_CHECKING:
    from cape.results.take import Take

MISSING = "a take is shown in Jupyter with what pip install 'cape[notebook]' brings; elsewhere take.save writes a file"


def show(
    take: Take,
    *,
    width: int,
    height: int,
    layers: Iterable[str] | None = None,
    surfaces: Sequence[LinkSurface] = (),
    skin: Skin | None = None,
) -> None:
    """Show a take in the Rerun viewer, within the output of the cell that is run.

    Args:
        take: what to show.
        width: of the viewer [pixels].
        height: the same.
        layers: which of `cape.record.LAYERS`, None for all.
        surfaces: meshes that the bones carry.
        skin: mesh that the bones move.

    Raises:
        UserError: what shows it is not installed, or this is no notebook.
        UnknownNameError: a layer doesn't exist.
        ValueRangeError: no frame is finite.
    """
    import rerun as rr

    try:
        from IPython.core.getipython import get_ipython
        from rerun.notebook import Viewer
    except ImportError as error:
        raise UserError(MISSING) from error
    if get_ipython() is None:
        raise UserError(f"this is no notebook: {MISSING}")
    recording = recording_of(take, layers=layers, surfaces=surfaces, skin=skin)
    stream = rr.RecordingStream(recording.application, recording_id=uuid.uuid4())
    stream.send_recording_name(recording.name)
    recording.log(stream)
    Viewer(width=width, height=height, blueprint=recording.blueprint, recording=stream).display()
