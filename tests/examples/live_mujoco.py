"""A cloth on MuJoCo's bodies, beside MuJoCo's own viewer: the robot is drawn there, the cloth in Rerun.

`python live_mujoco.py --show` opens both, which needs a display; without it nothing is shown, for a second. MuJoCo
(`pip install mujoco`) runs in the main thread, as its viewer wants, and leaves where the bodies are for the thread of
the cloth.
"""

# What mujoco holds is found at run time alone.
# pyright: reportAttributeAccessIssue=false

import contextlib
import sys
import time

import mujoco

import cape
from motions import quaternions

SHOW = "--show" in sys.argv
model = mujoco.MjModel.from_xml_string("""
<mujoco>
  <option timestep="0.005"/>
  <worldbody>
    <light pos="0 0 3"/>
    <body name="arm" pos="0 0 1.6">
      <joint axis="0 1 0" damping="0.02"/>
      <geom type="capsule" fromto="0 0 0  0.5 0 0" size="0.05"/>
    </body>
  </worldbody>
</mujoco>
""")
data = mujoco.MjData(model)
mujoco.mj_forward(model, data)


def bodies():
    """A copy: MuJoCo goes on with its own."""
    return {"arm": (data.body("arm").xpos.copy(), data.body("arm").xquat.copy())}


newest = bodies()
half = quaternions.rotate(model.geom(0).quat, [0.0, 0.0, model.geom(0).size[1]])  # MuJoCo's capsules lie along Z
arm = cape.Capsule("arm", "arm", model.geom(0).pos - half, model.geom(0).pos + half, model.geom(0).size[0])
banner = cape.Cloth.rectangle(width=0.3, height=0.5, spacing=0.05, origin=(0.1, 0.06, 0.0), right=(1.0, 0.0, 0.0))
banner = banner.moved(*newest["arm"])
scene = cape.Scene(banner, [cape.attach(banner, "arm", "top")], [arm], wind=cape.Wind())


def viewer():
    if not SHOW:
        return contextlib.nullcontext()
    import mujoco.viewer

    return mujoco.viewer.launch_passive(model, data)


live = cape.Live(scene, lambda _: newest, viewer="window" if SHOW else "none", keep=True)
with viewer() as shown, live:
    begun = time.monotonic()
    while live.running and time.monotonic() < begun + (60.0 if SHOW else 1.0):
        mujoco.mj_step(model, data, nstep=2)
        newest = bodies()
        if shown is not None:
            if not shown.is_running():
                break
            shown.sync()
        time.sleep(2 * model.opt.timestep)
take = live.take()
print(f"{len(take.positions)} frames; the banner's lowest point was {take.positions[..., 2].min():.2f} m high")
