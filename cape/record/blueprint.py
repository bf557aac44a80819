"""The layout that a recording opens with."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING

from cape.record.stage import BACKGROUND

if TYPE_CHECKING:
    import rerun.blueprint as rrb

# In the frame of /world/character: X ahead, Y to the left, Z up, the pelvis at the origin [m].
EYE = (-2.55, -1.75, 0.75)
EYE_TARGET = (0.0, 0.0, -0.1)
LINING_TINT = (120, 120, 120)


def layout(layers: Collection[str]) -> rrb.Blueprint:
    """A view that follows the figure from behind, a second one with the hitboxes a tab away, the curves below.

    The views' origin is /world/character, so that the eye keeps its place beside the figure, and can still be turned
    about it by hand.
    """
    import rerun.blueprint as rrb

    scene = _scene(layers)
    time = rrb.TimePanel(timeline="time", state="collapsed", play_state="playing", loop_mode="all")
    if "plots" not in layers:
        return rrb.Blueprint(scene, time, collapse_panels=True)
    curves = rrb.Horizontal(
        *(
            rrb.TimeSeriesView(origin=f"/plots/{entity}", name=title, plot_legend=rrb.PlotLegend(visible=False))
            for entity, title in [
                ("stretch", "largest stretch [%]"),
                ("penetration", "deepest penetration [mm]"),
                ("kinetic_energy", "kinetic energy [J]"),
            ]
        )
    )
    return rrb.Blueprint(rrb.Vertical(scene, curves, row_shares=[4, 1]), time, collapse_panels=True)


def _scene(layers: Collection[str]) -> rrb.View | rrb.Container:
    import rerun as rr
    import rerun.blueprint as rrb

    labelled = {"/world/hitboxes": rr.Capsules3D.from_fields(show_labels=True).visualizer()}
    if "cape" not in layers:
        return _view("hitboxes", overrides=labelled)
    if "hitboxes" not in layers:
        return _view("cape", overrides=_two_sided())
    return rrb.Tabs(
        _view("cape", overrides=_two_sided(), hidden=("/world/hitboxes",)),
        _view("hitboxes", overrides=labelled | _two_sided()),
        active_tab="cape",
    )


def _two_sided():
    import rerun as rr

    return {
        "/world/cape": [
            rr.Mesh3D.from_fields(face_rendering="Front").visualizer(),
            rr.Mesh3D.from_fields(face_rendering="Back", albedo_factor=LINING_TINT).visualizer(),
        ]
    }


def _view(name: str, *, overrides, hidden=()) -> rrb.View:
    import rerun.blueprint as rrb

    return rrb.Spatial3DView(
        origin="/world/character",
        contents=["/world/**", *(f"- {path}" for path in hidden)],
        name=name,
        overrides=overrides,
        background=BACKGROUND,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(position=EYE, look_target=EYE_TARGET),
    )
