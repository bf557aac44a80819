"""Vertices of cloth that a limb has gone through, which slip off it.

Two limbs that close on a cloth may leave its threads around one of them, and no contact brings them back: all vertices
are outside, on every side. Each triangle that the limb's middle goes through (`run.contact.slips` finds them) is let go
of by that limb, and its corners are led along it towards its tip as long as they are in it: they are stopped there as
contact stops what comes in from beyond the tip. What slips off a forearm meets a hand there, which lets it go as well.
"""

from cape.kernels.jit import inlined

NOT = -1  # in place of a collider


@inlined
def is_let_go(colliders, c, i):
    """Tell whether vertex i slips off collider c, or over that: it then does not stop it at its nearest side."""
    off = colliders.slips[i]
    return off != NOT and (off == c or colliders.beyond[off] == c)
