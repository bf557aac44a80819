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

# In the frame of /world/character: X ahead, Y to the left, Z up, the pelvis at the origin [m].
EYE = (-2.05, -1.05, 0.45)
EYE_TARGET = (0.0, 0.0, -0.08)
LINING_COLOR = (58, 66, 104)
MANNEQUIN_COLOR = (150, 152, 158)


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

    labelled = {"/world/hitboxes": [rr.Capsules3D.from_fields(show_labels=True).visualizer()]}
    if "cape" not in layers:
        return _view("hitboxes" if "hitboxes" in layers else "scene", overrides=labelled)
    if "hitboxes" not in layers:
        return _view("cape", overrides=_two_sided())
    return rrb.Tabs(
        _view("cape", overrides=_two_sided() | _mannequin()),
        _view("hitboxes", overrides=labelled | _two_sided()),
        active_tab="cape",
    )


def _two_sided() -> Overrides:
    """Draw one mesh twice, its back with the lining: a second mesh for the lining would double the file."""
    import rerun as rr

    outside = rr.Mesh3D.from_fields(face_rendering="Front")
    lining = rr.Mesh3D.from_fields(face_rendering="Back", **albedo(plain(LINING_COLOR)))
    return {"/world/cape": [outside.visualizer(), lining.visualizer()]}


def _mannequin() -> Overrides:
    """Draw the hitboxes as a solid body that wears the cape."""
    import rerun as rr

    solid = rr.Capsules3D.from_fields(
        fill_mode=rr.components.FillMode.Solid, colors=[MANNEQUIN_COLOR], show_labels=False
    )
    return {"/world/hitboxes": [solid.visualizer()]}


def _view(name: str, *, overrides: Overrides, hidden: Collection[str] = ()) -> rrb.View:
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
