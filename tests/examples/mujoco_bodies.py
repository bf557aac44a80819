"""MuJoCo's bodies, as those of any simulator, carry a cloth.

Here a swinging arm carries a banner, which its own capsules keep out. It needs `pip install mujoco`, and no
Pinocchio.
"""

# What mujoco holds is found at run time alone.
# pyright: reportAttributeAccessIssue=false

import mujoco

import cape
from motions import quaternions

model = mujoco.MjModel.from_xml_string("""
<mujoco>
  <option timestep="0.005"/>
  <worldbody>
    <body name="upper_arm" pos="0 0 1.6">
      <joint axis="0 1 0"/>
      <geom name="upper_arm" type="capsule" fromto="0 0 0  0.4 0 0" size="0.05"/>
      <body name="forearm" pos="0.4 0 0">
        <joint axis="0 1 0"/>
        <geom name="forearm" type="capsule" fromto="0 0 0  0.4 0 0" size="0.04"/>
      </body>
    </body>
  </worldbody>
</mujoco>
""")
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)

capsules = []
for geom in map(model.geom, range(model.ngeom)):
    half = quaternions.rotate(geom.quat, [0.0, 0.0, geom.size[1]])  # MuJoCo's capsules lie along Z
    bone = model.body(geom.bodyid[0]).name
    capsules.append(cape.Capsule(geom.name, bone, geom.pos - half, geom.pos + half, geom.size[0]))


def bodies():
    return {name: (data.body(name).xpos, data.body(name).xquat) for name in ("upper_arm", "forearm")}


# In the forearm's frame: 0.3 m wide along it, from 5 cm beside it downwards. Then to where the forearm is.
banner = cape.Cloth.rectangle(width=0.3, height=0.5, spacing=0.05, origin=(0.05, 0.05, 0.0), right=(1.0, 0.0, 0.0))
banner = banner.moved(*bodies()["forearm"])
simulation = cape.Simulation(cape.Scene(banner, [cape.attach(banner, "forearm", "top")], capsules, wind=cape.Wind()))
simulation.start(bodies())
for _ in range(60):
    mujoco.mj_step(model, data, nstep=4)
    simulation.step(bodies(), 4 * model.opt.timestep)
print(f"the banner hangs down to {simulation.positions[:, 2].min():.2f} m")
