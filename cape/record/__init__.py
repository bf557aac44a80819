"""Recordings for the Rerun viewer.

What is in a recording, by entity path (an interface: scripts may rely on it):

| Layer | Entity | Archetype | Every frame | Once |
|---|---|---|---|---|
| cape | `/world/cape` | Mesh3D | vertex positions, normals | triangles, texture coordinates, textures |
| skeleton | `/world/skeleton` | LineStrips3D | a strip from each bone's parent to the bone | radius, colour |
| hitboxes | `/world/hitboxes` | Capsules3D | translations, quaternions | lengths, radii, colours, labels |
| hitboxes | `/world/colliders/<name>` | Boxes3D, Ellipsoids3D | centre, quaternion, if a bone carries it | the rest |
| floor | `/world/floor` | Mesh3D | | everything |
| plots | `/plots/stretch` | Scalars | largest strain of a structural edge [%] | name, colour |
| plots | `/plots/penetration` | Scalars | deepest penetration of a vertex [mm] | name, colour |
| plots | `/plots/kinetic_energy` | Scalars | of the cloth [J] | name, colour |
| always | `/world/character` | Transform3D | place and heading of the figure, which the camera follows | |

Lengths are metres in a right-handed world with Z up, in single precision. A row stands on two timelines: `frame`, the
frame's number, and `time`, its time [s] as a duration.

The layout that comes along draws the hitboxes twice from the same data: in the tab `cape` as a solid body, in the tab
`hitboxes` as they are logged, translucent and with their names.
"""

from cape.record.layers import LAYERS
from cape.record.write import save, save_hitboxes

__all__ = ["LAYERS", "save", "save_hitboxes"]
