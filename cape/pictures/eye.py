"""Where the eye of a view stands around the character."""

import math
from typing import Any

from motions.errors import UnknownNameError, ValueRangeError

SIDES = {"front": 0.0, "left": 90.0, "back": 180.0, "right": 270.0}


def side_of(text: str) -> float:
    """The angle around the character [degrees] of a side by name, or of a number.

    Raises:
        UnknownNameError: it is neither.
    """
    if text in SIDES:
        return SIDES[text]
    try:
        angle = float(text)
    except ValueError:
        angle = math.nan
    if not math.isfinite(angle):
        raise UnknownNameError("side", text, SIDES, "An angle around the character will do as well: 30 [degrees]")
    return angle


def look_from(layout: dict[str, Any], view: str, degrees: float) -> dict[str, Any]:
    """A layout in which a view is seen from another side, as far away and as high above what it looks at.

    Args:
        layout: parts of a blueprint by their paths, as the viewer tells them.
        view: id of the view.
        degrees: angle about Z from X, which points ahead of the character, to where the eye stands.

    Raises:
        ValueRangeError: the layout doesn't place that view's eye.
    """
    path = f"/view/{view}/EyeControls3D"
    eye = layout.get(path, {}).get("EyeControls3D", {})
    if "position" not in eye or "look_target" not in eye:
        raise ValueRangeError("the view can't be seen from another side: its layout doesn't tell where its eye stands")
    target = eye["look_target"]
    away = math.hypot(eye["position"][0] - target[0], eye["position"][1] - target[1])
    angle = math.radians(degrees)
    place = [target[0] + away * math.cos(angle), target[1] + away * math.sin(angle), eye["position"][2]]
    return layout | {path: {"EyeControls3D": eye | {"position": place}}}
