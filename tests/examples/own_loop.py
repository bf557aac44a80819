"""Bones from anywhere: a simulation takes plain arrays, in a loop of one's own."""

import numpy as np

import cape

sheet = cape.Cloth.rectangle(width=1.0, height=1.0, spacing=0.05)
scene = cape.Scene(sheet, [cape.attach(sheet, "rod", "top")], wind=cape.Wind(velocity=(0.0, 3.0, 0.0)))
simulation = cape.Simulation(scene)
for frame in range(60):
    swing = np.array([0.1 * np.sin(0.1 * frame), 0.0, 0.0])
    simulation.step({"rod": (swing, [1.0, 0.0, 0.0, 0.0])}, 1 / 60)  # position [m], quaternion wxyz, time step [s]
print(simulation.positions.shape)  # [m], in the world
