"""Takes velocity from a simulation, to bring it to rest sooner."""

from cape.run.simulation import Simulation


def brake(simulation: Simulation, share: float) -> None:
    """Leave a share of the velocity of a simulation."""
    snapshot = simulation.snapshot()
    state = snapshot.place.state.copy()
    state[:, 3:] *= share
    simulation.start_from(snapshot._replace(place=snapshot.place._replace(state=state)))
