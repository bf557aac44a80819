"""Colliders are spheres, boxes, planes, capsules, tapered capsules, cylinders and ellipsoids, on bones or in the world.

A limb's whole way through a step counts, not only its end; limbs thinner than the mesh are kept out of triangles,
too. What two colliders close upon is held midway between them and comes out by its own side as they part; a cape
that starts inside of one leaves at 3 m/s at most. Where bones jump (a cut, a teleport) the cape is carried along,
or put on anew where it would then lie in a limb; always by `cuts=cape.Cuts(then="reset")`. `simulate` leaves out
what the cloth can't reach and says so in `take.left_out`; `cape.reach.reach_of(scene, track).cull(scene)` does that
for a loop of one's own.
"""

import numpy as np

import cape

sheet = cape.Cloth.rectangle(width=0.6, height=0.6, spacing=0.05, origin=(0.0, 0.0, 0.4))
ball = cape.Sphere(bone="hand", radius=0.1, thickness=0.004, friction=0.6)
scene = cape.Scene(sheet, [], [ball, cape.Plane()], self_contact=cape.SelfContact())
simulation = cape.Simulation(scene)
for _ in range(30):
    simulation.step({"hand": (np.array([0.3, 0.3, 0.2]), [1.0, 0.0, 0.0, 0.0])}, 1 / 60)
print(f"lowest point {simulation.positions[:, 2].min():.3f} m")
