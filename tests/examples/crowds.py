"""Many characters share the cores."""

import numpy as np

import cape

sheet = cape.Cloth.rectangle(width=1.0, height=1.0, spacing=0.05)
scene = cape.Scene(sheet, [cape.attach(sheet, "rod", "top")])
crowd = cape.Batch([cape.Simulation(scene) for _ in range(4)])
rods = [{"rod": (np.array([2.0 * k, 0.0, 0.0]), [1.0, 0.0, 0.0, 0.0])} for k in range(4)]
crowd.start(rods)
for _ in range(10):
    crowd.step(rods, 1 / 60)
print([positions.shape for positions in crowd.positions])
