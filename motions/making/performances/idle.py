"""Standing at ease."""

import numpy as np

from motions.clip import Clip
from motions.making.body import SIDES
from motions.making.figure import STANDING, Upper, arm, balanced, on_ground, spot, turned
from motions.making.score import FPS

DURATION = 6.0


def idle() -> Clip:
    """Two breaths, while the weight goes from one leg to the other; continues into itself."""
    t = np.arange(round(DURATION * FPS)) / FPS
    weight, breath = 2 * np.pi * t / DURATION, 4 * np.pi * t / DURATION
    shift = np.sin(weight) - 0.12 * np.sin(3 * weight)
    inhaled = 0.5 - 0.5 * np.cos(breath - 0.6 * np.sin(breath))
    look = 7.0 * np.sin(weight - 0.9) + 2.0 * np.sin(2 * weight)
    sway = 1.5 * np.sin(weight - 0.8)
    upper = Upper(
        pelvis=turned(yaw=1.5 * shift, roll=2.2 * shift, pitch=1.0 + 0.3 * np.sin(weight + 1.0)),
        chest=turned(yaw=-1.0 * shift, roll=-1.4 * shift, pitch=2.5 - 2.2 * inhaled),
        head=turned(yaw=look, roll=-0.6 * shift, pitch=3.0 - 0.8 * inhaled + 1.2 * np.cos(weight)),
        arms={
            side: arm(
                flexion=2 + sway,
                abduction=5 + 1.0 * inhaled + sign * 0.8 * shift,
                twist=10,
                elbow=14 + 1.5 * np.sin(weight - 1.2),
            )
            for side, sign in SIDES.items()
        },
    )
    center = np.column_stack(
        [0.045 + 0.005 * np.sin(2 * weight + 0.5), 0.030 * shift, STANDING + 0.002 * inhaled - 0.004 * shift**2]
    )
    still = {side: on_ground(side, np.tile(spot(side), (len(t), 1))) for side in SIDES}
    return balanced(center, upper, lambda hips: still).clip("idle", FPS)
