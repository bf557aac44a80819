"""What `cape replay --check` tells: how deep a take is in its colliders, measured apart from the solver, and the error
of its time step."""

from typing import Any

import numpy as np

from cape.results.penetration import Deepest, penetration
from cape.results.take import Take


def checked(take: Take) -> dict[str, dict[str, Any]]:
    """The deepest vertex and the deepest point of any face [mm], in what and at which frame, of what no bone holds."""
    counted = np.ones(take.positions.shape[1], dtype=bool)
    counted[take.held] = False
    found = penetration(take, counted=counted)
    return {
        "vertices": _facts(take, found.vertices, "vertex"),
        "faces": _facts(take, found.faces, "triangle"),
    }


def step_error_facts(take: Take) -> dict[str, Any] | None:
    """The error of the time step, as `Take.step_error`, and that of its worst part [mm]; None where none was told."""
    if not take.step_errors:
        return None
    return {
        "rms_mm": round(1e3 * take.step_error, 4),
        "max_mm": round(1e3 * max(error.rms for error in take.step_errors), 4),
        "seconds": round(max(error.seconds for error in take.step_errors), 4),
        "parts": len(take.step_errors),
    }


def step_error_rows(facts: dict[str, Any] | None) -> list[tuple[str, str]]:
    """A labelled text for the terminal."""
    if facts is None:
        return []
    return [
        (
            "time-step error",
            f"{facts['rms_mm']:.2g} mm gathered in {facts['seconds']:g} s, {facts['max_mm']:.2g} mm at most, of "
            f"{facts['parts']} parts",
        ),
        ("", "that is, RMS over the vertices, from where infinitely short steps of the same solver would have led"),
    ]


def check_rows(facts: dict[str, dict[str, Any]]) -> list[tuple[str, str]]:
    """Labelled texts for the terminal."""
    rows = []
    for kind, fact in facts.items():
        text = f"{fact['depth_mm']:.1f} mm"
        if fact["collider"] is not None:
            where = "triangle" if "triangle" in fact else "vertex"
            text += f" in {fact['collider']} at frame {fact['frame']}, {where} {fact[where]}"
        rows.append((f"check of {kind}", text))
    return rows


def _facts(take: Take, found: Deepest, what: str) -> dict[str, Any]:
    frame = int(found.depth.argmax())
    inside = int(found.collider[frame]) >= 0
    return {
        "depth_mm": round(1000.0 * float(found.depth[frame]), 3),
        "collider": take.colliders[int(found.collider[frame])].name if inside else None,
        "frame": frame if inside else None,
        what: int(found.index[frame]) if inside else None,
    }
