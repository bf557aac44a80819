"""The wind at a cloth, from frame to frame, where it is not everywhere and always alike."""

import numpy as np
from numpy.typing import NDArray

from cape.air.wakes import Wakes
from cape.air.wind import Wind
from cape.assembly.assemble import Assembly
from cape.kernels.state import State
from cape.scene.poses import Pose
from motions.errors import ValueRangeError

FloatArray = NDArray[np.float64]

AIR = ("density", "drag", "lift", "viscous")  # of a wind, what the cloth is set out with


class Weather:
    """Blows on an assembled cloth."""

    def __init__(self, assembly: Assembly) -> None:
        """Find what keeps the wind off; nothing blows yet."""
        scene = assembly.scene
        self._stream, self._steady, self._wind = assembly.stream, assembly.wind, scene.wind
        self._air = () if scene.wind is None else tuple(getattr(scene.wind, name) for name in AIR)
        shelters = scene.wind is not None and scene.wind.shelter and bool(scene.colliders)
        self._wakes = Wakes(scene.colliders, scene.bones) if shelters else None

    def turn_to(self, wind: Wind) -> None:
        """Have another wind blow from now on.

        Raises:
            ValueRangeError: the cloth hangs in no air, or was set out for a wind that is steady where this one is not.
        """
        if self._wind is None:
            raise ValueRangeError("the scene has no air for a wind to blow: give it a Wind")
        if wind.varies and self._stream is None:
            raise ValueRangeError("a steady wind can only be followed by a steady one: start with gusts, however weak")
        if (wind.density, wind.drag, wind.lift, wind.viscous) != self._air:
            raise ValueRangeError("another wind is of the same air: leave density, drag, lift and viscous as they are")
        self._wind = wind
        if self._stream is None:
            self._steady[:] = wind.velocity

    def blow(self, state: State, origin: FloatArray, poses: tuple[Pose, Pose], time: float, duration: float) -> None:
        """Set the stream for a frame, from where its vertices are and how fast.

        The wind is taken at its begin and its end, and goes straight from one to the other: that does not depend on
        how many steps the frame is taken in.

        Args:
            state: of the vertices, about an origin.
            origin: in the world [m], shape (3,).
            poses: of the bones about the origin, at the begin and the end, with the world last.
            time: of the begin, from the start of the motion [s].
            duration: of the frame [s].

        Raises:
            ValueRangeError: the field of the wind gives no finite velocities.
        """
        if self._stream is None or self._wind is None:
            return
        places, velocities = (np.stack(part, axis=1).astype(float) for part in (state[:3], state[3:]))
        for now, into, pose in ((0.0, self._stream.begin, poses[0]), (duration, self._stream.end, poses[1])):
            there = places + now * velocities + origin
            into[:] = self._wind.at(time + now, there).T
            if self._wakes is not None:
                into *= self._wakes.left(there, self._wind.stream(time + now), *pose.moved(origin))
