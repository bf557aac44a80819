"""A high front kick."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from motions.clip import Clip
from motions.curves import bridged
from motions.making.figure import STANDING, Foot, Upper, arm, balanced, hanging, on_ground, spot, turned
from motions.making.score import FPS, score

FloatArray = NDArray[np.float64]

STEP = 0.48
LEAVE, LAND = 0.98, 2.10


def kick() -> Clip:
    """A step onto the left foot and a kick with the right one, which is then set down beside it."""
    moments = score(
        3.7,
        ready=0.15, peel=0.26, lift=0.38, swing=0.50, guard=0.77, heel=0.82, flat=0.94,
        leave=LEAVE, cock=1.20, chamber=1.30, impact=1.45, fold=1.63, back=1.70,
        near=2.06, land=LAND, down=2.22, settled=2.90,
    )  # fmt: skip
    upper = Upper(
        pelvis=turned(
            yaw=moments(ready=0, guard=-16, impact=22, back=10, land=-4, settled=0),
            roll=moments(swing=0, leave=2, impact=-5, land=1, settled=0),
            pitch=moments(ready=1, guard=6, chamber=-4, impact=-24, back=-8, land=8, settled=1),
        ),
        chest=turned(
            yaw=moments(ready=0, guard=10, impact=-12, back=-4, land=6, settled=0),
            pitch=moments(ready=2, guard=8, chamber=2, impact=-16, back=4, land=14, settled=2),
        ),
        head=turned(pitch=moments(ready=3, impact=2, land=6, settled=3)),
        arms={
            "Left": arm(
                flexion=moments(ready=2, guard=42, chamber=48, impact=38, back=46, land=40, settled=2),
                abduction=moments(ready=5, guard=22, impact=38, land=22, settled=5),
                twist=moments(ready=10, guard=26, land=26, settled=10),
                elbow=moments(ready=14, guard=92, impact=70, land=88, settled=14),
            ),
            "Right": arm(
                flexion=moments(ready=2, guard=36, chamber=20, impact=-34, back=12, land=38, settled=2),
                abduction=moments(ready=5, guard=20, impact=34, land=20, settled=5),
                twist=moments(ready=10, guard=26, impact=10, land=24, settled=10),
                elbow=moments(ready=14, guard=98, chamber=84, impact=34, land=88, settled=14),
            ),
        },
    )
    ahead = STEP + 0.06
    center = np.column_stack(
        [
            moments(ready=0.045, heel=0.33, leave=ahead - 0.05, impact=ahead, land=ahead, settled=STEP + 0.045),
            moments(ready=0, lift=-0.055, leave=0.07, impact=0.085, back=0.08, land=0.03, settled=0),
            STANDING + moments(ready=0, guard=-0.045, chamber=0.05, impact=0.095, back=0.04, land=-0.03, settled=0),
        ]
    )
    forward, upward = np.array([STEP, 0.0, 0.0]), np.array([0.0, 0.0, 0.07])
    stepping = np.outer(moments.share("lift", "heel"), forward) + np.outer(moments.hump("lift", "heel"), upward)
    left = on_ground(
        "Left",
        spot("Left") + stepping,
        pitch=moments.radians(peel=0, swing=-24, heel=16, flat=0, chamber=0, impact=-14, back=0),
    )
    planted = on_ground(
        "Right",
        spot("Right") + np.outer(moments.share("chamber", "back"), forward),
        pitch=moments.radians(guard=0, leave=-46, chamber=0, near=8, land=6, down=0),
    )
    thigh = moments.radians(leave=-16, chamber=98, impact=116, fold=100, near=24)
    knee = moments.radians(leave=34, cock=112, chamber=116, impact=8, fold=108, near=44)
    ankle_flexion = moments.radians(leave=-20, chamber=4, impact=-16, back=4)
    pitch = bridged(
        moments.times, planted.pitch, thigh - knee + ankle_flexion, leave=LEAVE, land=LAND, fade=0.25, slope_fade=0.10
    )
    toes = planted.toes * (1 - moments.share("leave", "cock"))

    def feet(hips: dict[str, FloatArray]) -> dict[str, Foot]:
        free = hanging(hips["Right"], thigh, knee)
        ankle = bridged(moments.times, planted.ankle, free, leave=LEAVE, land=LAND, fade=0.25, slope_fade=0.10)
        return {"Left": left, "Right": replace(planted, ankle=ankle, pitch=pitch, toes=toes)}

    return balanced(center, upper, feet).clip("kick", FPS)
