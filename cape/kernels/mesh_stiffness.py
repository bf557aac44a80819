"""Products with the stiffness of a mesh, link by link as in `kernels.mesh`; see `kernels.stiffness` for the matrix.

Each link holds w and c of its spring, with bending added to c: the matrix of all bends is one of differences along
links, some of them of negative weight. `coefficients` has the rows wx, wy, wz, c of each of D rows of links, (4 D, N);
`ends` (3, D N + 1) is room for what each link keeps for its other end.
"""

from cape.kernels.jit import driver, inlined, kernel
from cape.kernels.linearise import linearised
from cape.kernels.mesh import collect
from cape.kernels.team import meet


@kernel
def linearise_links(
    count, x, y, z, all_x, all_y, all_z, others, stiffness, rest, weight, stretched, bend_scale, tiny, wx, wy, wz, c
):
    """Fill w and c of one row of links; their owners are x, y, z, their other ends are found in all vertices."""
    for i in range(count):
        j = others[i]
        wx[i], wy[i], wz[i], spring = linearised(
            all_x[j] - x[i], all_y[j] - y[i], all_z[j] - z[i], stiffness[i], rest[i], stretched, tiny
        )
        c[i] = spring + bend_of(weight, i, bend_scale)


@inlined
def bend_of(weight, i, scale):
    """Bending along link i [N/m], 0 without bending."""
    if weight is None:
        return 0
    return scale * weight[i]


@kernel
def multiply_links(others, wx, wy, wz, c, px, py, pz, all_px, all_py, all_pz, ex, ey, ez, qx, qy, qz):
    """Add one row of links times p to q at their owners, and keep the opposite for their other ends."""
    for i in range(qx.size):
        j = others[i]
        dx, dy, dz = px[i] - all_px[j], py[i] - all_py[j], pz[i] - all_pz[j]
        along = wx[i] * dx + wy[i] * dy + wz[i] * dz
        sx, sy, sz = along * wx[i] + c[i] * dx, along * wy[i] + c[i] * dy, along * wz[i] + c[i] * dz
        ex[i], ey[i], ez[i] = -sx, -sy, -sz
        qx[i] += sx
        qy[i] += sy
        qz[i] += sz


@kernel
def keep_diagonals(wx, wy, wz, c, ex, ey, ez, xx, yy, zz):
    """Add the diagonals of the blocks of one row of links to their owners, and keep them for the other ends."""
    for i in range(xx.size):
        ex[i], ey[i], ez[i] = wx[i] * wx[i] + c[i], wy[i] * wy[i] + c[i], wz[i] * wz[i] + c[i]
        xx[i] += ex[i]
        yy[i] += ey[i]
        zz[i] += ez[i]


@kernel
def keep_mixed(wx, wy, wz, ex, ey, ez, xy, xz, yz):
    """The same for the entries beside the diagonal, which c does not touch."""
    for i in range(xy.size):
        ex[i], ey[i], ez[i] = wx[i] * wy[i], wx[i] * wz[i], wy[i] * wz[i]
        xy[i] += ex[i]
        xz[i] += ey[i]
        yz[i] += ez[i]


@driver
def linearise_mesh(lo, hi, s, links, bends, stretched, bend_scale, coefficients):
    """Fill w and c of the links that vertices lo to hi own."""
    for d in range(links.second.shape[0]):
        w = coefficients[4 * d : 4 * d + 4]
        linearise_links(
            hi - lo, s.x[lo:], s.y[lo:], s.z[lo:], s.x, s.y, s.z, links.second[d, lo:],
            links.stiffness[d, lo:], links.rest[d, lo:], _row(bends, d, lo), stretched, bend_scale,
            s.x.dtype.type(1e-18), w[0, lo:hi], w[1, lo:hi], w[2, lo:hi], w[3, lo:hi],
        )  # fmt: skip


@inlined
def _row(bends, d, lo):
    if bends is None:
        return None
    return bends.weight[d, lo:]


@driver
def add_mesh_product(lo, hi, links, coefficients, ends, p, q, team):
    """Add the product of a mesh's links with p to q on the vertices lo to hi."""
    count = links.second.shape[1]
    for d in range(links.second.shape[0]):
        w, at = coefficients[4 * d : 4 * d + 4], d * count + lo
        multiply_links(
            links.second[d, lo:], w[0, lo:], w[1, lo:], w[2, lo:], w[3, lo:], p[0, lo:], p[1, lo:], p[2, lo:],
            p[0], p[1], p[2], ends[0, at:], ends[1, at:], ends[2, at:], q[0, lo:hi], q[1, lo:hi], q[2, lo:hi],
        )  # fmt: skip
    meet(team)
    collect(lo, hi, links.start, links.incoming, ends, q[0], q[1], q[2])


@driver
def add_mesh_blocks(lo, hi, links, coefficients, ends, blocks, team):
    """Add a mesh's links to the blocks of the vertices lo to hi."""
    count = links.second.shape[1]
    for d in range(links.second.shape[0]):
        w, at = coefficients[4 * d : 4 * d + 4], d * count + lo
        keep_diagonals(
            w[0, lo:], w[1, lo:], w[2, lo:], w[3, lo:],
            ends[0, at:], ends[1, at:], ends[2, at:], blocks[0, lo:hi], blocks[1, lo:hi], blocks[2, lo:hi],
        )  # fmt: skip
    meet(team)
    collect(lo, hi, links.start, links.incoming, ends, blocks[0], blocks[1], blocks[2])
    meet(team)
    for d in range(links.second.shape[0]):
        w, at = coefficients[4 * d : 4 * d + 4], d * count + lo
        keep_mixed(
            w[0, lo:], w[1, lo:], w[2, lo:], ends[0, at:], ends[1, at:], ends[2, at:],
            blocks[3, lo:hi], blocks[4, lo:hi], blocks[5, lo:hi],
        )  # fmt: skip
    meet(team)
    collect(lo, hi, links.start, links.incoming, ends, blocks[3], blocks[4], blocks[5])
    meet(team)
