"""A simulation that chooses its solver and steps from a tolerance, or from the time that a frame may take."""

from cape.run.auto.choice import Auto
from cape.run.auto.simulation import AutoSimulation

__all__ = ["Auto", "AutoSimulation"]
