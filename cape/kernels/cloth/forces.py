"""The forces between vertices and of the air: one model, shared by all solvers."""

from cape.kernels.cloth.grid import grid_air_forces, grid_forces
from cape.kernels.cloth.mesh import mesh_air_forces, mesh_forces
from cape.kernels.jit import driver, kernel


@driver
def compute_forces(lo, hi, s, model, fx, fy, fz, room, team):
    """Set the forces on vertices lo to hi [N] to those of the `model`, without gravity.

    Reads the state of all vertices; writes nothing but f[lo:hi] and `room`, the scratch of this thread.
    """
    add_grid(
        lo, hi, s, model.grid, model.grid_bends, model.grid_air, model.damping, model.bend_damping, fx, fy, fz, room
    )
    add_mesh(
        lo, hi, s, model.mesh, model.mesh_bends, model.mesh_air, model.damping, model.bend_damping, fx, fy, fz, team
    )
    add_skin(lo, hi, s, model.skin, fx, fy, fz)


@driver
def add_grid(lo, hi, s, springs, bends, air, damping, bend_damping, fx, fy, fz, room):
    """Set the forces of a grid cloth; nothing at all where `springs` is None."""
    if springs is not None:
        if bends is not None:
            grid_forces(
                lo, hi, s, springs.offsets, springs.stiffness, springs.rest, damping,
                bends.stiffness, bend_damping, fx, fy, fz, room,
            )  # fmt: skip
        else:
            grid_forces(
                lo, hi, s, springs.offsets, springs.stiffness, springs.rest, damping, None, None, fx, fy, fz, room
            )
    if air is not None:
        grid_air_forces(lo, hi, s, air.wind, air.drag, air.lift, air.cells, air.columns, fx, fy, fz, room)


@driver
def add_mesh(lo, hi, s, springs, bends, air, damping, bend_damping, fx, fy, fz, team):
    """Set the forces of a mesh cloth; nothing at all where `springs` is None."""
    if springs is not None:
        mesh_forces(lo, hi, s, springs, bends, damping, bend_damping, fx, fy, fz, team)
    if air is not None:
        mesh_air_forces(lo, hi, s, air, fx, fy, fz, team)


@driver
def add_skin(lo, hi, s, skin, fx, fy, fz):
    """Add what the air's viscosity exerts; nothing at all where `skin` is None."""
    if skin is not None:
        wind, dtype = skin.wind, s.x.dtype.type
        brake(
            dtype(wind[0]), dtype(wind[1]), dtype(wind[2]), skin.drag[lo:hi], s.vx[lo:hi], s.vy[lo:hi], s.vz[lo:hi],
            fx[lo:hi], fy[lo:hi], fz[lo:hi],
        )  # fmt: skip


@kernel
def brake(wind_x, wind_y, wind_z, drag, vx, vy, vz, fx, fy, fz):
    """Add forces that are linear in the velocities against the wind."""
    for i in range(drag.size):
        fx[i] += drag[i] * (wind_x - vx[i])
        fy[i] += drag[i] * (wind_y - vy[i])
        fz[i] += drag[i] * (wind_z - vz[i])
