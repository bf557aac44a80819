"""What keeps a cloth together: springs or a membrane, and bend springs, with damping."""

from typing import TYPE_CHECKING, ClassVar, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.assembly.assemble import Assembly
from cape.assembly.springs import Springs
from cape.cloth.cloth import GridCloth
from cape.cloth.fabric import Fabric
from cape.cloth.split_mesh import SplitMesh
from cape.forces.base import Acting, Force
from cape.kernels.cloth.grid import GridBends, GridForces, GridSprings, grid_bends, grid_springs
from cape.kernels.cloth.membrane import MembraneForces, MeshMembrane, mesh_membrane
from cape.kernels.cloth.mesh import Added, MeshForces, MeshSprings, add_forces, mesh_springs
from cape.kernels.cloth.mesh_bending import MeshBendForces, MeshBends, mesh_bends
from cape.kernels.program import Use
from cape.scene.scene import Scene

if TYPE_CHECKING:
    from cape.assembly.mesh.pieces import Piece
    from cape.assembly.mesh.split_records import Splits


class Elastic(Force):
    """Springs between vertices, and bend springs; Kelvin and Voigt's damping in both."""

    name: ClassVar[str] = "elastic"
    account: ClassVar[Literal["elastic", "air", "hold"]] = "elastic"
    sets: ClassVar[bool] = True

    @staticmethod
    def acts(scene: Scene) -> bool:
        """Always."""
        return True

    @staticmethod
    def arrays(assembly: Assembly, dtype: type[np.floating]) -> "Links":
        """The springs and bend springs, of a grid by family, or of a mesh by link; or a membrane."""
        return links_of(assembly, dtype)

    @staticmethod
    def uses(acting: Acting, arrays: "Links") -> list[Use]:
        """One unit for a grid; for a mesh one of springs or of a membrane, and one of bending where there is any.

        Pieces of other fabrics have units of their own, and one that adds up what these set.
        """
        uses = Elastic._uses_of(arrays, acting)
        for piece in arrays.pieces:
            uses += Elastic._uses_of(piece.links, acting._replace(forces=piece.forces))
            uses.append(Use(add_forces, Added(piece.forces, acting.forces)))
        return uses

    @staticmethod
    def _uses_of(a: "Links", acting: Acting) -> list[Use]:
        """The units of the springs of a cloth, or of a piece of it."""
        state, forces = acting.state, acting.forces
        if isinstance(a.springs, GridSprings):
            assert acting.room is not None
            assert not isinstance(a.bends, MeshBends)
            group = GridForces(state, a.springs, a.bends, a.damping, a.bend_damping, forces, acting.room)
            return [Use(grid_springs, group)]
        assert not isinstance(a.bends, GridBends)
        if isinstance(a.springs, MeshMembrane):
            uses = [Use(mesh_membrane, MembraneForces(state, a.springs, a.damping, forces))]
        else:
            uses = [Use(mesh_springs, MeshForces(state, a.springs, a.damping, forces))]
        if a.bends is not None:
            uses.append(Use(mesh_bends, MeshBendForces(state, a.bends, a.bend_damping, forces)))
        return uses

    @staticmethod
    def energy(assembly: Assembly, positions: NDArray[np.float64]) -> float:
        """Energy of stretched and bent springs, and of a membrane [J]."""
        springs = assembly.springs
        lengths = np.linalg.norm(positions[springs.second] - positions[springs.first], axis=1)
        stretched = 0.5 * float(springs.stiffness @ (lengths - springs.rest) ** 2)
        if springs.membrane is not None:
            stretched += springs.membrane.energy(positions)
        return stretched + Elastic.energy_of_bending(assembly, positions)

    @staticmethod
    def energy_of_bending(assembly: Assembly, positions: NDArray[np.float64]) -> float:
        """The part of that which bent springs hold [J]."""
        springs = assembly.springs
        bends = np.einsum("km,kmc->kc", springs.bend_coefficients, positions[springs.bend_vertices])
        return 0.5 * float(springs.bend_stiffness @ np.sum(bends**2, axis=1))


class Links(NamedTuple):
    """Springs or a membrane, and bend springs, in a precision, with damping times [s]; None for what a cloth lacks.

    `splits` tells where they stand in a mesh that may split. `pieces` are those of other fabrics, on the same vertices,
    where kernels take for one number what differs; the rest is then of the first.
    """

    springs: GridSprings | MeshSprings | MeshMembrane
    bends: GridBends | MeshBends | None
    damping: float | None
    bend_damping: float | None
    splits: "Splits | None" = None
    pieces: "tuple[PieceLinks, ...]" = ()


class PieceLinks(NamedTuple):
    """The springs of a piece, and room for the forces (3, N) [N] that they set."""

    links: Links
    forces: NDArray[np.floating]


def damping_times(fabric: Fabric, springs: Springs) -> tuple[float | None, float | None]:
    """Damping times [s] of springs and of bend springs; None for none."""
    has_bends = len(springs.bend_stiffness) > 0
    return fabric.damping_time or None, (fabric.bend_damping_time or None) if has_bends else None


def links_of(assembly: Assembly, dtype: type[np.floating]) -> Links:
    """The springs of a cloth as kernels take them."""
    springs, count = assembly.springs, assembly.cloth.vertices
    times, has_bends = damping_times(assembly.cloth.fabric, springs), len(springs.bend_stiffness) > 0
    if isinstance(assembly.cloth, GridCloth):
        families = springs.families
        if families is None:
            raise TypeError("the springs of a grid come by family")
        bends = None
        if has_bends:
            bends = grid_bends(families.bend_stiffness, families.twist_stiffness, assembly.cloth.columns, dtype)
        grid = GridSprings(families.offsets, families.stiffness.astype(dtype), families.rest.astype(dtype))
        return Links(grid, bends, *times)
    if isinstance(assembly.cloth, SplitMesh) and springs.in_slots:
        from cape.assembly.mesh.split_records import split_bends_record, split_membrane_record, split_springs_record
        from cape.assembly.mesh.split_springs import SplitMeshSprings

        assert isinstance(springs, SplitMeshSprings)
        in_plane = split_springs_record if springs.membrane is None else split_membrane_record
        record, splits = in_plane(springs, assembly.cloth, dtype)
        return Links(record, split_bends_record(springs, count, dtype) if has_bends else None, *times, splits)
    from cape.assembly.mesh.pieces import alike_pieces

    first, *others = (_mesh_links(piece, dtype) for piece in alike_pieces(assembly.cloth, springs))
    return first._replace(pieces=tuple(PieceLinks(links, np.zeros((3, count), dtype)) for links in others))


def _mesh_links(piece: "Piece", dtype: type[np.floating]) -> Links:
    """The springs of a piece of a mesh."""
    from cape.assembly.mesh.links import mesh_bends_record, mesh_membrane_record, mesh_springs_record

    springs, count, whole = piece.springs, len(piece.vertices), bool(piece.vertices.all())
    times = damping_times(piece.fabric, springs)
    bends = mesh_bends_record(springs, count, dtype) if len(springs.bend_stiffness) else None
    if springs.membrane is not None:
        record = mesh_membrane_record(springs.membrane, count, dtype, piece=not whole)
        return Links(record, bends, *times)
    return Links(mesh_springs_record(springs, count, dtype), bends, *times)
