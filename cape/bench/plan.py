"""How much is measured."""

from dataclasses import dataclass

from cape.solvers import SOLVERS


@dataclass(frozen=True, kw_only=True)
class Plan:
    """What `run` measures and how long.

    Attributes:
        solvers: names of the solvers.
        repeats: turns of every variant, of which the fastest counts.
        least: length of a turn [s].
        all_precisions: compare single with double precision for all solvers, not for symplectic Euler alone.
        table: vertex counts at which all solvers, layouts and precisions are compared.
        vertices: vertex counts of the grid with symplectic Euler.
        mesh_vertices: the same for the mesh.
        other_vertices: the same for the other solvers, on the grid.
        thread_vertices: vertex counts at which one thread and two are compared.
        capes: numbers of capes in a batch.
        cape_vertices: vertex count of each of them, and of the scene with and without features.
        seconds: of the plain scene with symplectic Euler.
        other_seconds: the same with the other solvers.
    """

    solvers: tuple[str, ...] = tuple(SOLVERS)
    repeats: int
    least: float
    all_precisions: bool
    table: tuple[int, ...]
    vertices: tuple[int, ...]
    mesh_vertices: tuple[int, ...]
    other_vertices: tuple[int, ...]
    thread_vertices: tuple[int, ...]
    capes: tuple[int, ...]
    cape_vertices: int = 1536
    seconds: float = 10.0
    other_seconds: float = 10.0


SIZES = (500, 1_500, 5_000, 10_000, 20_000, 50_000, 100_000, 200_000)
CAPES = (1, 2, 4, 8, 16, 32, 64)

FULL = Plan(
    repeats=9,
    least=0.03,
    all_precisions=True,
    table=(1_536, 10_000),
    vertices=SIZES,
    mesh_vertices=SIZES,
    other_vertices=(500, 1_500, 5_000, 20_000),
    thread_vertices=(1_536, 5_000, 20_000, 100_000),
    capes=CAPES,
)
QUICK = Plan(
    repeats=7,
    least=0.02,
    all_precisions=False,
    table=(1_536, 10_000),
    vertices=SIZES,
    mesh_vertices=(500, 1_500, 5_000, 10_000),
    other_vertices=(500, 1_500, 5_000),
    thread_vertices=(1_536, 20_000),
    capes=(1, 4, 16, 64),
    other_seconds=2.0,
)
