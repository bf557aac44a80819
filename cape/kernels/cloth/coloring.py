"""Greedy colouring."""

import numpy as np

from cape.kernels.jit import routine


@routine
def first_fit(members, met, colors):
    """Give each of E constraints on m vertices (E, m) the first colour that none of its vertices has met.

    `met` (V, W) has a bit for each colour that a vertex has met, all zero; enough words W for all colours.
    """
    one, full = np.uint64(1), ~np.uint64(0)
    for k in range(members.shape[0]):
        for word in range(met.shape[1]):
            taken = np.uint64(0)
            for a in range(members.shape[1]):
                taken |= met[members[k, a], word]
            if taken == full:
                continue
            color = 0
            while (taken >> np.uint64(color)) & one:
                color += 1
            for a in range(members.shape[1]):
                met[members[k, a], word] |= one << np.uint64(color)
            colors[k] = 64 * word + color
            break
