"""How well a robot follows a clip, as a command tells it."""

from collections.abc import Iterable, Mapping
from typing import Any

from skeleton import Retargeted

NAMED = 3  # joints at their limits that a line names


def retarget_facts(found: Retargeted) -> dict[str, Any]:
    """The figures as JSON has them: distances in cm by role, shares of frames by joint."""
    return {
        "scale": round(found.scale, 4),
        "errors_cm": {
            role: {"rms": round(100.0 * error.rms, 2), "max": round(100.0 * error.max, 2)}
            for role, error in found.errors.items()
        },
        "sliding_cm": round(100.0 * found.sliding, 2),
        "hover_mm": round(1000.0 * found.hover, 2),
        "at_limits": {joint: round(share, 3) for joint, share in found.at_limits.items()},
        "at_top_speed": {joint: round(share, 3) for joint, share in found.at_top_speed.items()},
    }


def retarget_rows(facts: Mapping[str, Any]) -> list[tuple[str, str]]:
    """The same for the terminal, none without facts."""
    if not facts:
        return []
    errors = facts["errors_cm"]
    groups = [("hands", "hand"), ("feet", "foot"), ("elbows", "forearm"), ("knees", "shin")]
    texts = [f"{name} {_worst(errors, role)}" for name, role in groups if any(r.endswith(role) for r in errors)]
    rows = [
        ("retargeted", f"{facts['scale']:.3f} times as large; off by, RMS and at most, {', '.join(texts)} cm"),
        ("", f"standing feet slide {facts['sliding_cm']:.1f} cm, hover {facts['hover_mm']:.1f} mm at most"),
    ]
    for label, key in (("at their limits", "at_limits"), ("as fast as the robot is or faster", "at_top_speed")):
        if shares := sorted(facts[key].items(), key=lambda item: -item[1]):
            more = f" and {len(shares) - NAMED} more" if len(shares) > NAMED else ""
            named = ", ".join(f"{joint} {share:.0%}" for joint, share in shares[:NAMED])
            rows.append(("", f"{label}, share of frames: {named}{more}"))
    return rows


def _worst(errors: Mapping[str, Mapping[str, float]], role: str) -> str:
    """The larger of both sides' errors."""
    sides: Iterable[Mapping[str, float]] = [error for name, error in errors.items() if name.endswith(role)]
    return f"{max(side['rms'] for side in sides):.1f} and {max(side['max'] for side in sides):.1f}"
