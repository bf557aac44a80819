"""Proportions of the human body: what bones don't tell about the flesh around them, as fractions of stature.

Girths, breadths and depths are means of ANSUR II (Gordon et al. 2014, "2012 Anthropometric Survey of U.S. Army
Personnel: Methods and Summary Statistics", NATICK/TR-15/007; 1986 women, 4082 men). Each is divided by the mean stature
of its sex, and the two fractions are averaged. Heights of joints are those of Drillis and Contini (1966, "Body Segment
Parameters") as drawn in Winter, "Biomechanics and Motor Control of Human Movement", fig. 4.1.
"""

from math import pi

_STATURE = (1.6285, 1.7562)


def _mean_fraction(women: float, men: float) -> float:
    """Mean over the sexes of a measure [m] as a fraction of stature."""
    return (women / _STATURE[0] + men / _STATURE[1]) / 2


def _radius(*girths: tuple[float, float]) -> float:
    """Radius of a round limb whose girth is the mean of those at its places measured, women's and men's [m]."""
    return sum(_mean_fraction(*girth) for girth in girths) / len(girths) / (2 * pi)


# Girths [m] of women and men; those of wrist, lower thigh and ankle to 0.003 of the stature.
_NECK = (0.3298, 0.3976)
_BICEPS_FLEXED = (0.3056, 0.3581)
_FOREARM_FLEXED = (0.2641, 0.3101)
_WRIST = (0.153, 0.177)
_UPPER_THIGH = (0.6161, 0.6251)
_LOWER_THIGH = (0.399, 0.408)
_CALF = (0.3733, 0.3923)
_ANKLE = (0.215, 0.232)

CHEST_BREADTH = 0.165
"""ANSUR II, chest breadth: 0.165 women and men."""
WAIST_BREADTH = 0.185
"""ANSUR II, waist breadth: 0.184 women, 0.186 men."""
HIP_BREADTH = 0.207
"""ANSUR II, hip breadth: 0.217 women, 0.197 men."""
TRUNK_DEPTH = 0.140
"""Between chest depth (0.145) and waist depth (0.135) of ANSUR II's men; women's chest depth includes the bust."""

HEAD_HEIGHT = 0.130
"""Chin to vertex: 1 - 0.870, Drillis and Contini."""
HEAD_JOINT_TO_VERTEX = 0.10
"""A skeleton's head joint sits where skull and neck meet, about the height of the mouth (0.90)."""
SHOULDER_HEIGHT = 0.818
"""Shoulder joint above the floor, Drillis and Contini."""
HIP_HEIGHT = 0.530
"""Hip joint above the floor, Drillis and Contini."""
SHOULDER_JOINTS_APART = 0.259
"""Distance of the two shoulder joints, Drillis and Contini."""
ARM_LENGTH = 0.332
"""Shoulder joint to wrist along a straight arm: upper arm 0.186 and forearm 0.146, Drillis and Contini."""
ANKLE_HEIGHT = 0.039
"""Ankle joint above the floor, Drillis and Contini."""
HAND_LENGTH = 0.108
"""Wrist to fingertip, Drillis and Contini."""
FOOT_REACH = 0.115
"""Ankle joint to the tip of the toes: foot length 0.152, Drillis and Contini, less a quarter behind the ankle."""

RADII: dict[str, float] = {
    # Mean of head breadth (0.088 men, 0.091 women) and head length (0.114, 0.115) of ANSUR II, halved.
    "head": (0.0895 + 0.1145) / 4,
    "neck": _radius(_NECK),
    # The trapezius and the deltoid are about as thick as the upper arm.
    "shoulder": _radius(_BICEPS_FLEXED),
    "chest": TRUNK_DEPTH / 2,
    "pelvis": TRUNK_DEPTH / 2,
    # A limb that tapers gets the mean of its thickest and its thinnest girth.
    "upper_arm": _radius(_BICEPS_FLEXED, _FOREARM_FLEXED),
    "forearm": _radius(_FOREARM_FLEXED, _WRIST),
    # A flat hand and a foot: mean of breadth (ANSUR II: 0.049, 0.0575) and of a thickness of about half of it.
    "hand": 0.049 * 0.75 / 2,
    "thigh": _radius(_UPPER_THIGH, _LOWER_THIGH),
    "shin": _radius(_CALF, _ANKLE),
    "foot": 0.0575 * 0.75 / 2,
}
"""Radius of each kind of capsule."""
