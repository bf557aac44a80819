"""A cape that is simulated as the clock runs, on bones of one's own, in a viewer that it never waits for.

The physics has a thread of its own and asks where the bones are before each step. Here a stick swings. `python live.py
window` opens the Rerun viewer, `web` serves it to a browser on this machine; without a word nothing is shown.
"""

import sys

import numpy as np

import cape

viewer, seconds = sys.argv[1] if len(sys.argv) > 1 else "none", 1.5

banner = cape.Cloth.rectangle(width=0.8, height=1.0, spacing=0.05, origin=(0.0, 0.4, 1.5))
scene = cape.Scene(banner, [cape.attach(banner, "stick", "top")], wind=cape.Wind(velocity=(2.0, 0.0, 0.0)))


def bones(time):
    """Where the bones are at a time [s]: position [m] and quaternion wxyz of each."""
    return {"stick": ([0.2 * np.sin(2.0 * time), 0.0, 0.0], [1.0, 0.0, 0.0, 0.0])}


with cape.Live(scene, bones, viewer=viewer, keep=True) as live:
    live.wait(seconds / 3)
    live.changes.set_wind((-4.0, 0.0, 0.0))  # at once
    live.wait(seconds / 3)
    live.changes.set_fabric("denim")  # built beside the run, which goes on with it then
    live.wait(seconds / 3)
take = live.take()
print(f"{len(take.positions)} frames, {live.status.step_ms:.1f} ms each")
