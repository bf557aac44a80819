"""Springs of a mesh that may split, by slots that stay: where a few edges part, a few springs change in place.

Each of the 3 T sides of triangles has a slot for an edge. The first side of an edge holds its spring; the slot of the
other is idle until the edge parts, and then holds the spring of that border. Behind them is a slot for the cross spring
over each edge within. What was fitted at rest stays as it is: of patches (`cape.assembly.mesh.in_plane`), and of
bending where no triangle that it is made of has another neighbour, or another corner, than before. So does the choice
between springs and a membrane, which was made for the whole mesh.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from cape.assembly.fabrics import fabrics_of
from cape.assembly.membrane import membrane_of
from cape.assembly.mesh.curvature import Unfolded, unfold
from cape.assembly.mesh.following import Changed, Following
from cape.assembly.mesh.in_plane import InPlane, corner, fit_in_plane
from cape.assembly.mesh.springs import MISSED, bends_of, layered_area
from cape.assembly.springs import Springs
from cape.cloth.cloth import MeshCloth
from cape.cloth.split_mesh import SplitMesh
from cape.cloth.triangle_mesh import edges_of

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]


@dataclass(frozen=True, eq=False, kw_only=True)
class SplitMeshSprings(Springs):
    """The springs of a mesh that may split, by slots; an idle one has no stiffness.

    There are three bend springs for each triangle, or none at all.

    Attributes:
        faces: vertices of the triangles as they are now, shape (T, 3).
        fitted: what patches of triangles ask for.
        unfolded: how triangles lie beside each other.
        along: which sides lie along threads, shape (3 T,).
        over: slots of the cross springs over the edges that sides are, -1 for none, shape (3 T,).
        following: has them follow the mesh.
    """

    faces: IntArray
    fitted: InPlane
    unfolded: Unfolded
    along: NDArray[np.bool_]
    over: IntArray
    following: Following

    @property
    def in_slots(self) -> bool:
        """Whether they follow a mesh that splits in place, some of them idle as yet: they do."""
        return True

    def acts(self, slots: IntArray) -> NDArray[np.bool_]:
        """Which of some slots (n,) are not idle, shape (n,)."""
        count = len(self.fitted.mate)
        edge = np.minimum(slots, count - 1)
        return np.where(slots < count, self.fitted.mate[edge] >= edge, self.stiffness[slots] > 0.0)

    @property
    def acting_numbers(self) -> IntArray:
        """Those slots that are not idle."""
        return np.flatnonzero(self.acts(np.arange(len(self.first))))

    @property
    def acting_slots(self) -> IntArray:
        """Those slots that are not idle, in the order of the vertices at their ends."""
        slots = self.acting_numbers
        return slots[np.lexsort((self.second[slots], self.first[slots]))]

    @property
    def acting(self) -> "ActingSprings":
        """Those that are not idle, as `mesh_springs` gives them."""
        slots, bends = self.acting_slots, np.flatnonzero(self.bend_stiffness > 0.0)
        return ActingSprings(slots=self, **self.among(slots, bends), membrane=self.membrane)


@dataclass(frozen=True, eq=False, kw_only=True)
class ActingSprings(Springs):
    """The springs of a mesh that may split which are not idle.

    Attributes:
        slots: all of them.
    """

    slots: SplitMeshSprings


def split_mesh_springs(cloth: SplitMesh) -> SplitMeshSprings:
    """Derive the springs of a mesh that may split, whole as yet or not."""
    edges, area = edges_of(cloth.faces), layered_area(cloth)
    fitted, unfolded = fit_in_plane(cloth, edges, area), unfold(cloth, edges)
    sides = np.arange(3 * len(area))
    within = edges.sides[:, 0]
    membrane = membrane_of(cloth, edges) if fitted.missed() > MISSED else None
    if membrane is not None:
        within, membrane = within[:0], replace(membrane, faces=cloth.faces.copy())
    over = np.full(len(sides), -1)
    over[within] = over[fitted.mate[within]] = len(sides) + np.arange(len(within))
    edge_stiffness = np.where(fitted.mate >= sides, fitted.edge_stiffness(sides), 0.0)
    nearest = None
    if membrane is not None:
        nearest, edge_stiffness = edge_stiffness, np.zeros(len(sides))
    ends = np.concatenate([_ends(cloth.faces, sides), _crossing(cloth.faces, fitted, within)])
    along = _along(cloth)
    bends = bends_of(cloth, unfolded, area, np.arange(len(area) if _bending(cloth) > 0.0 else 0))
    return SplitMeshSprings(
        first=np.ascontiguousarray(ends[:, 0]),
        second=np.ascontiguousarray(ends[:, 1]),
        stiffness=np.concatenate([edge_stiffness, fitted.cross_stiffness(within)]),
        rest=np.concatenate([fitted.edge_lengths(sides), fitted.cross_length[within]]),
        measured=np.concatenate([along & (fitted.mate >= sides), np.zeros(len(within), bool)]),
        bend_vertices=bends.vertices,
        bend_coefficients=bends.coefficients,
        bend_stiffness=bends.stiffness,
        membrane=membrane,
        nearest=nearest,
        faces=cloth.faces.copy(),
        fitted=fitted,
        unfolded=unfolded,
        along=along,
        over=over,
        following=Following(),
    )


def follow_split(
    springs: SplitMeshSprings, cloth: SplitMesh, copied: IntArray, positions: FloatArray
) -> tuple[SplitMeshSprings, Changed]:
    """Have springs follow a mesh that has split further at some of its vertices (n,), in place but for wider bends.

    `positions` (N, 3) [m] are those of its vertices, new ones where those are that they are copies of.
    """
    return springs.following.follow(springs, cloth, copied, positions)


def sides_of(triangles: IntArray) -> IntArray:
    """The sides of some triangles (n,), shape (3 n,)."""
    return (3 * triangles[:, None] + np.arange(3)).ravel()


def _ends(faces: IntArray, sides: IntArray) -> IntArray:
    """Vertices at the ends of some sides (n,), the lower one first, shape (n, 2)."""
    flat = faces.reshape(-1)
    return np.sort(np.stack([flat[sides], flat[corner(sides, 1)]], axis=1), axis=1)


def _crossing(faces: IntArray, fitted: InPlane, sides: IntArray) -> IntArray:
    """Vertices opposite of some edges within, given by a side (n,), the lower one first, shape (n, 2)."""
    flat = faces.reshape(-1)
    return np.sort(np.stack([flat[corner(sides, 2)], flat[corner(fitted.mate[sides], 2)]], axis=1), axis=1)


def _along(cloth: MeshCloth) -> NDArray[np.bool_]:
    """Which sides of a mesh lie along threads, shape (3 T,); all where that is not known."""
    sides = np.arange(3 * len(cloth.faces))
    if cloth.threads is None:
        return np.ones(len(sides), bool)
    return np.isin(_ends(cloth.faces, sides) @ [cloth.vertices, 1], cloth.threads @ [cloth.vertices, 1])


def _bending(cloth: MeshCloth) -> float:
    """The largest stiffness against bending of its fabrics [N m]."""
    return max(bend for fabric in fabrics_of(cloth) for bend in (fabric.bend_weft, fabric.bend_warp))
