"""The layout that a recording opens with."""

from __future__ import annotations

from collections.abc import Collection
from typing import TYPE_CHECKING, Any

from cape.record.stage import BACKGROUND
from cape.record.textures import albedo, plain

if TYPE_CHECKING:
    import rerun.blueprint as rrb

# Visualizers by the path of the entity that they draw; a dict of the invariant type that Rerun asks for.
Overrides = dict[Any, Any]

# In the frame of /world/character: X ahead, Y to the left, Z up, the pelvis at the origin; in heights of the skeleton.
EYE = (-1.27, -0.78, 0.31)
EYE_TARGET = (0.0, 0.0, 0.0)
LINING_COLOR = (58, 66, 104)
BODY_COLOR = (172, 170, 168)
BODY_LINE_COLOR = (120, 119, 118)  # darker, as lines are not lit


def layout(layers: Collection[str], height: float) -> rrb.Blueprint:
    """A view that follows the figure from behind, a second one with the hitboxes a tab away, the curves below.

    The views' origin is /world/character, so that the eye keeps its place beside the figure, and can still be turned
    about it by hand.

    Args:
        layers: what is in the recording.
        height: of the skeleton [m], which the views are to hold.
    """
    import rerun.blueprint as rrb

    scene = _scene(layers, height)
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


def _scene(layers: Collection[str], height: float) -> rrb.View | rrb.Container:
    import rerun as rr
    import rerun.blueprint as rrb

    labelled = {"/world/hitboxes": [rr.Capsules3D.from_fields(show_labels=True).visualizer()]}
    if "cape" not in layers:
        return _view("hitboxes" if "hitboxes" in layers else "scene", height, overrides=labelled)
    if "hitboxes" not in layers:
        return _view("cape", height, overrides=_two_sided())
    return rrb.Tabs(
        _view("cape", height, overrides=_two_sided() | _mannequin()),
        _view("hitboxes", height, overrides=labelled | _two_sided()),
        active_tab="cape",
    )


def _two_sided() -> Overrides:
    """Draw one mesh twice, its back with the lining: a second mesh for the lining would double the file."""
    import rerun as rr

    outside = rr.Mesh3D.from_fields(face_rendering="Front")
    lining = rr.Mesh3D.from_fields(face_rendering="Back", **albedo(plain(LINING_COLOR)))
    return {"/world/cape": [outside.visualizer(), lining.visualizer()]}


def _mannequin() -> Overrides:
    """Draw the hitboxes as a solid body that wears the cape, and what no capsule covers, such as fingers, like it."""
    import rerun as rr

    solid = rr.components.FillMode.Solid
    body = rr.Capsules3D.from_fields(fill_mode=solid, colors=[BODY_COLOR], show_labels=False)
    rest = rr.LineStrips3D.from_fields(colors=[BODY_LINE_COLOR])
    return {"/world/hitboxes": [body.visualizer()], "/world/skeleton": [rest.visualizer()]}


def _view(name: str, height: float, *, overrides: Overrides) -> rrb.View:
    import rerun.blueprint as rrb

    return rrb.Spatial3DView(
        origin="/world/character",
        contents="/world/**",
        name=name,
        overrides=overrides,
        background=BACKGROUND,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            position=[height * part for part in EYE], look_target=[height * part for part in EYE_TARGET]
        ),
    )
