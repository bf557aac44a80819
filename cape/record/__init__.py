"""Recordings for the Rerun viewer.

What is in a recording, by entity path (an interface: scripts may rely on it):

| Layer | Entity | Archetype | Every frame | Once |
|---|---|---|---|---|
| cape | `/world/cape` | Mesh3D | vertex positions, normals | triangles, texture coordinates, textures |
| cape | `/world/clasp` | Mesh3D, Transform3D | where both ends of the collar are | a boss for each and a cord |
| robot | `/world/robot/<bone>` | Transform3D | where the bone is | |
| robot | `/world/robot/<bone>/<name>` | Mesh3D | | everything: a mesh of the link that the bone carries |
| body | `/world/body/<bone>` | Transform3D | where the bone is | |
| body | `/world/body/<bone>/<name>` | Mesh3D | | everything: a part of the body, where no robot is drawn |
| body | `/world/body/<piece>` | Mesh3D | vertex positions, normals | triangles, colours: of a character's own mesh |
| skeleton | `/world/skeleton` | LineStrips3D | a strip from each bone's parent to the bone | radius, colour |
| hitboxes | `/world/hitboxes` | Capsules3D | translations, quaternions | lengths, radii, colours, labels |
| hitboxes | `/world/colliders/<name>` | Boxes3D, Ellipsoids3D | centre, quaternion, if a bone carries it | the rest |
| hitboxes | `/world/colliders/<name>` | Mesh3D, Transform3D | where any other shape is | its surface, colour, label |
| shells | `/world/shells`, `/world/shells/<name>` | the same, nameless | the same | the same, grown by the thickness |
| contacts | `/world/contacts/points` | Points3D | places, colours by depth, class ids | size |
| contacts | `/world/contacts/normals` | Arrows3D | origins, the normals 5 cm long | colour, radius |
| contacts | `/world/contacts` | AnnotationContext | | names of the classes, which are the colliders |
| floor | `/world/floor` | Mesh3D | | everything |
| plots | `/plots/stretch` | Scalars | largest strain of a structural edge [%] | name, colour |
| plots | `/plots/penetration` | Scalars | deepest penetration of a vertex [mm] | name, colour |
| plots | `/plots/kinetic_energy` | Scalars | of the cloth [J] | name, colour |
| always | `/world/character` | Transform3D | place and heading of the figure, which the camera follows | |

Of several cloths on one character, `save([cape, skirt], ...)`, each has paths of its own: `/world/cloths/<name>`,
`/world/clasps/<name>`, `/world/contacts/<name>/...` and `/plots/stretch/<name>`, `/plots/penetration/<name>`,
`/plots/kinetic_energy/<name>`.

Lengths are metres in a right-handed world with Z up, in single precision. A row stands on two timelines: `frame`, the
frame's number, and `time`, its time [s] as a duration.

Of colliders that are no capsules 2,000 are drawn at most (`motions.limits.MOST_DRAWN`). One that was left out, as the
cloth can't reach it, is grey, and its label says so. A plane is drawn as a rectangle under all bones, the shell of a
box or a cylinder with sharp edges, that of an ellipsoid as the ellipsoid whose axes are longer by the thickness at each
end. A contact is a vertex within a collider's thickness at the end of a frame: its point lies on the collider's
surface, green where the vertex is at the outside of the thickness, yellow where it is at the surface, red where it is
inside the collider.

The layout that comes along has two tabs: `cape` with the body, or the robot, that wears the cape, and `hitboxes` with
these, translucent and with their names, with shells and contacts, and a cape to look through.
"""

from cape.record.layers import LAYERS
from cape.record.write import require_recorder, save, save_hitboxes

__all__ = ["LAYERS", "require_recorder", "save", "save_hitboxes"]
