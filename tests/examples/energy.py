"""Accounts of a run's energy.

What those who hold and touch the cloth do, what damping dissipates, what the method adds.

No bit of the run changes.
"""

import numpy as np

import cape

sheet = cape.Cloth.rectangle(width=0.6, height=0.6, spacing=0.05)
ledger = cape.Ledger()
scene = cape.Scene(sheet, [cape.attach(sheet, "rod", "top")], wind=cape.Wind(velocity=(0.0, 3.0, 0.0)))
simulation = cape.Simulation(scene, ledger=ledger)
for frame in range(60):
    simulation.step({"rod": (np.array([0.0, 0.0, 0.005 * frame]), [1.0, 0.0, 0.0, 0.0])}, 1 / 60)
balance = ledger.balance  # arrays in joules, an entry for each frame
print(f"the rod has done {balance.attachments[-1]:.3f} J of work, the air {balance.air[-1]:.3f} J")
print(f"{balance.numerical[-1]:.5f} J are the method's own, {balance.residual[-1]:.0e} J unaccounted for")
