"""A garment cut by hand on other bones: a skirt, a closed ring around the pelvis, beside a cape in one recording.

`moved` brings a cloth to where a bone is; `record.save` puts several takes of one motion into one recording. Each
cloth meets the colliders of its own scene, not the other cloth. `cape.dress(..., garment="skirt")` cuts one to a
body. A cloth may also be any triangle mesh (`cape.Cloth.from_mesh`), and `cape.cloth.sewing.sewn` joins panels,
each with threads of its own, where their edges lie at the same places.
"""

import cape
import motions
import skeleton
from cape import record

clip = motions.load("walk.bvh").trim(0.0, 1.0)
body = skeleton.Skeleton.from_clip(clip)
track = body.track(clip)
waist = track.positions[0, track.index("pelvis")] + [0.0, 0.0, 0.05]
skirt = cape.Cloth.skirt(waist=1.25, length=0.6, flare=1.6).moved(waist)
legs = body.capsules(only=["pelvis", "left_thigh", "right_thigh", "left_shin", "right_shin"])
worn = cape.Scene(skirt, [cape.attach(skirt, "pelvis", "waist")], legs, wind=cape.Wind())
takes = [
    cape.simulate(cape.dress(body, track), track, name="cape"),
    cape.simulate(worn, track, name="skirt"),
]
record.save(takes, "walk.rrd")
print([f"{take.name}: {take.result}" for take in takes])
