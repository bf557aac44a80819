"""What holds a cloth: bones by weights, springs, a rail to slide along, and bounds on how far it gets.

A clasp stays midway between both clavicles, and a collar follows neck and chest; a weight for each vertex
(`{"neck": up, "chest": 1 - up}`) does without a seam. With `stiffness=` springs hold the vertices, critically
damped unless `damping=` tells otherwise. `Tethers` let no vertex get farther from the nearest one that is held hard
than the cloth between them is long, and somewhat. With `along=` vertices slide along a curve that a bone carries,
like rings on a rail. `confine` keeps vertices near where bones would carry them: within `max_distance`, and out of
a sphere that begins `backstop` behind them, as in Unity's and Unreal's cloth; each a number, a map, or a function
of the distance along the cloth from what is held.
"""

import numpy as np

import cape

sheet = cape.Cloth.rectangle(width=0.6, height=0.6, spacing=0.05)
clasp = cape.attach(sheet, {"left_clavicle": 0.5, "right_clavicle": 0.5}, range(4, 9))
corners = cape.attach(sheet, "chest", [0, 12], stiffness=50.0)  # N/m each
scene = cape.Scene(sheet, [clasp, corners], tethers=cape.Tethers(slack=0.02))
simulation = cape.Simulation(scene)
for frame in range(30):
    bones = {name: (np.zeros(3), [1.0, 0.0, 0.0, 0.0]) for name in scene.bones}
    bones["left_clavicle"][0][2] = 0.002 * frame
    simulation.step(bones, 1 / 60)
print(f"the clasp is {1000 * (simulation.positions[6] - sheet.positions[6])[2]:.0f} mm higher, as half of 58")

rings = cape.attach(sheet, "rail", "top", along=[(-1.0, 0.0, 0.0), (1.0, 0.0, 0.0)])
near = cape.confine(sheet, "rail", max_distance=lambda way: 0.3 * way, backstop=0.02)
curtain = cape.Simulation(cape.Scene(sheet, [rings], confinements=[near], wind=cape.Wind(velocity=(0.0, 3.0, 0.0))))
for _ in range(30):
    curtain.step({"rail": (np.zeros(3), [1.0, 0.0, 0.0, 0.0])}, 1 / 60)
print(f"the curtain is blown {100 * curtain.positions[:, 1].max():.0f} cm, as far as its backstop lets it")
