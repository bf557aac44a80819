"""The layout that a recording opens with."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from cape.cloth.looks.look import Color
from cape.record.figure.body import BODY, BODY_COLOR
from cape.record.solids import labelled, plane_paths
from cape.record.stage import BACKGROUND, DARK_BACKGROUND, darkened_floor
from cape.record.surfaces.textures import albedo, plain
from cape.scene.colliders import Collider

if TYPE_CHECKING:
    import rerun.blueprint as rrb

# Visualizers by the path of the entity that they draw; a dict of the invariant type that Rerun asks for.
Overrides = dict[Any, Any]

# In the frame of /world/character: X ahead, Y to the left, Z up, the pelvis at the origin; in heights of the skeleton.
EYE = (-1.27, -0.78, 0.31)
EYE_TARGET = (0.0, 0.0, 0.0)
SEE_THROUGH = 110  # opacity of 255 of a cape that hides contacts
BODY_LINE_COLOR = (98, 102, 110)  # darker, as lines are not lit


def layout(
    layers: Collection[str],
    height: float,
    colliders: Sequence[Collider] = (),
    *,
    tab: str = "cape",
    linings: Mapping[str, Color | None] | None = None,
    notes: str | None = None,
    skinned: bool = False,
    follow: bool = False,
) -> rrb.Blueprint:
    """A view that follows the figure from behind, a second one for debugging contact a tab away, the curves below.

    The views' origin is /world/character, so that the eye keeps its place beside the figure, and can still be turned
    about it by hand.

    Args:
        layers: what is in the recording.
        height: of the skeleton [m], which the views are to hold.
        colliders: that are in the layer of hitboxes.
        tab: "cape" or "hitboxes", which of the two is in front.
        linings: colours of the cloths' insides by the cloths' paths, None for that of the outside; None for no cloth.
        notes: path of an entity with text to read beside the curves; None for none.
        skinned: whether the body is a mesh of the character's own.
        follow: show what comes last, as frames come, instead of playing it round and round.
    """
    import rerun.blueprint as rrb

    linings = linings or {}
    scene = _scene(layers, height, colliders, tab, linings, skinned=skinned)
    playing: dict[str, Any] = {"play_state": "following"} if follow else {"play_state": "playing", "loop_mode": "all"}
    time = rrb.TimePanel(timeline="time", state="collapsed", **playing)
    if "plots" not in layers:
        return rrb.Blueprint(scene, time, collapse_panels=True)
    legend = rrb.PlotLegend(visible=len(linings) > 1)
    read = [] if notes is None else [rrb.TextLogView(origin=notes, name="notes")]
    below = rrb.Horizontal(
        *(
            rrb.TimeSeriesView(origin=f"/plots/{entity}", name=title, plot_legend=legend)
            for entity, title in [
                ("stretch", "largest stretch [%]"),
                ("penetration", "deepest penetration [mm]"),
                ("kinetic_energy", "kinetic energy [J]"),
            ]
        ),
        *read,
    )
    return rrb.Blueprint(rrb.Vertical(scene, below, row_shares=[4, 1]), time, collapse_panels=True)


def _scene(
    layers: Collection[str],
    height: float,
    colliders: Sequence[Collider],
    tab: str,
    linings: Mapping[str, Color | None],
    *,
    skinned: bool,
) -> rrb.View | rrb.Container:
    import rerun.blueprint as rrb

    debugging = [layer for layer in ("hitboxes", "shells", "contacts") if layer in layers]
    if "cape" not in layers:
        return _view("hitboxes" if debugging else "scene", height, overrides=labelled(colliders), dark=bool(debugging))
    if not debugging:
        return _view("cape", height, overrides=_two_sided(linings))
    hidden = ["/world/shells", "/world/contacts", *plane_paths(colliders)]
    if "robot" in layers or skinned:
        figure = _unseen("/world/hitboxes", "/world/colliders", "/world/skeleton")
    elif "body" in layers:
        figure = _unseen("/world/hitboxes") | _body_lines()
    else:
        figure = _mannequin() | _body_lines()
    see_through = labelled(colliders) | _two_sided(linings, SEE_THROUGH)
    return rrb.Tabs(
        _view("cape", height, overrides=_two_sided(linings) | figure, hidden=hidden),
        _view("hitboxes", height, overrides=see_through, hidden=[] if skinned else [BODY], dark=True),
        active_tab=tab,
    )


def _two_sided(linings: Mapping[str, Color | None], opacity: int = 255) -> Overrides:
    """Draw each mesh with a lining twice, its back with that: a second mesh for the lining would double the file."""
    import rerun as rr

    tint: dict[str, Any] = {} if opacity == 255 else {"albedo_factor": (255, 255, 255, opacity)}
    outside = rr.Mesh3D.from_fields(face_rendering="Front", **tint)
    both = rr.Mesh3D.from_fields(face_rendering="DoubleSided", **tint)
    return {
        path: [both.visualizer()]
        if color is None
        else [
            outside.visualizer(),
            rr.Mesh3D.from_fields(face_rendering="Back", **tint, **albedo(plain(color))).visualizer(),
        ]
        for path, color in linings.items()
    }


def _mannequin() -> Overrides:
    """Draw the hitboxes as a solid body that wears the cape."""
    import rerun as rr

    solid = rr.components.FillMode.Solid
    body = rr.Capsules3D.from_fields(fill_mode=solid, colors=[BODY_COLOR], show_labels=False)
    return {"/world/hitboxes": [body.visualizer()]}


def _body_lines() -> Overrides:
    """Draw what no capsule covers, such as fingers, like the body."""
    import rerun as rr

    return {"/world/skeleton": [rr.LineStrips3D.from_fields(colors=[BODY_LINE_COLOR]).visualizer()]}


def _unseen(*paths: str) -> Overrides:
    """Hide entities until their eye is clicked."""
    import rerun.blueprint as rrb

    return {path: [rrb.EntityBehavior(visible=False)] for path in paths}


def _view(
    name: str, height: float, *, overrides: Overrides, hidden: Sequence[str] = (), dark: bool = False
) -> rrb.View:
    import rerun.blueprint as rrb

    return rrb.Spatial3DView(
        origin="/world/character",
        contents=["+ /world/**", *(f"- {path}/**" for path in hidden)],
        name=name,
        overrides=overrides | darkened_floor() if dark else overrides,
        background=DARK_BACKGROUND if dark else BACKGROUND,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            position=[height * part for part in EYE], look_target=[height * part for part in EYE_TARGET]
        ),
    )
