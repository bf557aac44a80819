"""A pirouette."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from motions import quaternions
from motions.clip import Clip
from motions.curves import bridged, step
from motions.making.body import BALL, about
from motions.making.figure import STANDING, TOE_OUT, Foot, Upper, arm, balanced, on_ground, spot, turned
from motions.making.score import FPS, Score, score

FloatArray = NDArray[np.float64]

TURNS = 2
LEAVE, LAND = 1.31, 3.54

# The raised foot's ankle seen from between the hips: in front of the other leg's knee.
RAISED = np.array([0.18, -0.09, -0.42])
BEHIND, LANDED = np.array([-0.26, -0.02, 0.0]), np.array([-0.03, -0.02, 0.0])


def spin() -> Clip:
    """Wound up, two turns to the right on the ball of the left foot with the arms drawn in, settled."""
    moments = score(
        4.8,
        ready=0.25, peel=0.34, back=0.40, away=0.55, placed=0.80, wind=0.95, push=1.25, leave=LEAVE, open=1.39,
        up=1.50, drawn=1.60, whirl=1.70, down=2.95, heel=3.00, close=3.35, land=LAND, flat=3.66, settled=4.25,
    )  # fmt: skip
    turn = -360.0 * TURNS * _ramp(moments, "push", "close", ease=0.30)
    wound = moments(ready=0, wind=22, push=20, drawn=0)
    facing = turn + wound
    # The head stays with the front as long as it can and is there again first.
    whirling = moments.share("push", "up") * (1 - moments.share("down", "land"))
    spotting = -38.0 * np.sin(np.radians(turn)) * whirling
    upper = Upper(
        pelvis=turned(
            yaw=facing,
            roll=moments(push=0, up=-3, down=-3, land=0),
            pitch=moments(ready=1, wind=4, up=0, down=0, land=5, settled=1),
        ),
        chest=turned(
            yaw=facing + moments(ready=0, wind=10, leave=-14, drawn=0, down=0, land=6, settled=0),
            pitch=moments(ready=2, wind=5, up=-1, down=-1, land=6, settled=2),
        ),
        head=turned(yaw=turn + 0.2 * wound + spotting, pitch=moments(ready=3, up=1, down=1, settled=3)),
        arms={
            "Left": arm(
                flexion=moments(ready=2, wind=22, up=42, down=42, land=24, settled=2),
                abduction=moments(ready=5, wind=74, push=76, drawn=30, down=30, land=58, settled=5),
                twist=moments(ready=10, wind=10, up=52, down=52, land=12, settled=10),
                elbow=moments(ready=14, wind=26, up=106, down=106, land=24, settled=14),
            ),
            "Right": arm(
                flexion=moments(ready=2, wind=58, push=52, open=42, up=40, down=40, land=24, settled=2),
                abduction=moments(ready=5, wind=18, open=62, whirl=30, down=30, land=58, settled=5),
                twist=moments(ready=10, wind=46, open=14, up=52, down=52, land=12, settled=10),
                elbow=moments(ready=14, wind=78, open=30, drawn=106, down=106, land=24, settled=14),
            ),
        },
    )
    turning = np.radians(turn)
    flat_ball = BALL * [1, 1, 0]
    ball = spot("Left") + quaternions.rotate(about("z", TOE_OUT), flat_ball)
    left = on_ground(
        "Left",
        ball - quaternions.rotate(about("z", TOE_OUT + turning), flat_ball),
        pitch=moments.radians(push=0, up=-38, heel=-38, land=0),
        turn=turning,
    )
    over_x, over_y = ball[:2]
    center = np.column_stack(
        [
            moments(ready=0.045, wind=-0.04, push=0.02, up=over_x, down=over_x, land=0.05, settled=0.045),
            moments(ready=0, away=0.05, wind=0.02, up=over_y, down=over_y, land=0.03, settled=0),
            STANDING + moments(ready=0, wind=-0.10, push=-0.09, up=0.10, down=0.10, land=-0.06, settled=0),
        ]
    )
    stepping = np.outer(moments.share("back", "placed"), BEHIND) + np.outer(
        moments.hump("back", "placed"), [0, 0, 0.05]
    )
    before = moments.times[:, None] < moments.at["whirl"]
    planted = on_ground(
        "Right",
        spot("Right") + np.where(before, stepping, LANDED),
        pitch=moments.radians(peel=0, away=-30, placed=-24, wind=-26, leave=-48, up=-30, down=-20, land=-18, flat=0),
    )
    timing = {"leave": LEAVE, "land": LAND, "slope_fade": 0.10}
    pointed = np.full_like(turn, np.radians(-58.0))
    pitch = bridged(moments.times, planted.pitch, pointed, fade=0.25, **timing)
    opened = moments.share("push", "up") * (1 - moments.share("heel", "flat"))
    in_air = moments.share("leave", "up") * (1 - moments.share("close", "land"))
    raised = replace(
        planted,
        pitch=pitch,
        yaw=planted.yaw + turning - 0.5 * opened,
        toes=planted.toes * (1 - in_air),
        knee_out=1.0 * opened,
    )

    def feet(hips: dict[str, FloatArray]) -> dict[str, Foot]:
        between = (hips["Left"] + hips["Right"]) / 2
        free = between + quaternions.rotate(about("z", np.radians(facing)), RAISED)
        ankle = bridged(moments.times, planted.ankle, free, fade=0.28, **timing)
        return {"Left": left, "Right": replace(raised, ankle=ankle)}

    return balanced(center, upper, feet).clip("spin", FPS)


def _ramp(moments: Score, start: str, end: str, *, ease: float) -> FloatArray:
    """From 0 to 1 between two moments, at constant speed but for the first and last `ease` [s], shape (F,)."""
    first, last = moments.at[start], moments.at[end]
    fine = np.linspace(first, last, 2001)
    speed = step(fine, first, first + ease) * (1 - step(fine, last - ease, last))
    area = np.concatenate([[0.0], np.cumsum((speed[1:] + speed[:-1]) / 2)])
    return np.interp(moments.times, fine, area / area[-1])
