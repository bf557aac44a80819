"""A binary tree of boxes, in which all pairs of leaves that overlap are found.

Nodes are in preorder: a node's first child follows it, and its second child what is below that. A tree is made once,
and its boxes are set anew from the leaves up: van den Bergen 1997, "Efficient collision detection of complex deformable
models using AABB trees", section 3.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from cape.kernels.jit import inlined, routine


class Tree(NamedTuple):
    """A tree over L leaves, which are numbered in the tree's order.

    `leaves` (2 L - 1,) is how many each node has below it, `first` the first of them; `boxes` (2 L - 1, 6) [m] are
    lowest and highest coordinates, and `waiting` (n, 2) has room for pairs of nodes.
    """

    leaves: NDArray[np.int64]
    first: NDArray[np.int64]
    boxes: NDArray[np.float64]
    waiting: NDArray[np.int64]


@inlined
def second_child(tree, node):
    """The second child of a node that is no leaf."""
    return node + 2 * tree.leaves[node + 1]


@routine
def set_boxes(tree, start, boxes):
    """Set the boxes of all nodes, of leaves to hold those of what they are made of.

    Leaf k holds `boxes` (6, n) from start[k] to start[k + 1].
    """
    for node in range(tree.leaves.size - 1, -1, -1):
        if tree.leaves[node] == 1:
            leaf = tree.first[node]
            for axis in range(3):
                low, high = boxes[axis, start[leaf]], boxes[axis + 3, start[leaf]]
                for k in range(start[leaf] + 1, start[leaf + 1]):
                    low = boxes[axis, k] if boxes[axis, k] < low else low
                    high = boxes[axis + 3, k] if boxes[axis + 3, k] > high else high
                tree.boxes[node, axis], tree.boxes[node, axis + 3] = low, high
        else:
            one, two = tree.boxes[node + 1], tree.boxes[second_child(tree, node)]
            for axis in range(3):
                tree.boxes[node, axis] = min(one[axis], two[axis])
                tree.boxes[node, axis + 3] = max(one[axis + 3], two[axis + 3])


@inlined
def begin_pairs(tree):
    """Put the whole tree beside itself among the pairs that are waiting; returns how many these are."""
    return wait(tree, 0, 0, 0)


@inlined
def wait(tree, count, a, b):
    """Put a pair of nodes behind those that are waiting; returns how many these are then."""
    tree.waiting[count, 0], tree.waiting[count, 1] = a, b
    return count + 1


@routine
def next_pair(tree, count):
    """The next pair of leaves that overlap, or are the same, and how many pairs of nodes are waiting then.

    The pair is of nodes, negative where there are no more. Each is found once, in the same order for the same boxes.
    """
    while count > 0:
        count -= 1
        a, b = tree.waiting[count, 0], tree.waiting[count, 1]
        if a == b:
            if tree.leaves[a] == 1:
                return a, a, count
            two = second_child(tree, a)
            count = wait(tree, wait(tree, wait(tree, count, a + 1, two), two, two), a + 1, a + 1)
        elif boxes_overlap(tree.boxes, a, b):
            if tree.leaves[a] == 1 and tree.leaves[b] == 1:
                return a, b, count
            if tree.leaves[a] >= tree.leaves[b]:
                count = wait(tree, wait(tree, count, second_child(tree, a), b), a + 1, b)
            else:
                count = wait(tree, wait(tree, count, a, second_child(tree, b)), a, b + 1)
    return -1, -1, 0


@inlined
def boxes_overlap(boxes, a, b):
    """Tell whether two nodes' boxes overlap."""
    return (
        (boxes[a, 0] < boxes[b, 3])
        & (boxes[a, 1] < boxes[b, 4])
        & (boxes[a, 2] < boxes[b, 5])
        & (boxes[b, 0] < boxes[a, 3])
        & (boxes[b, 1] < boxes[a, 4])
        & (boxes[b, 2] < boxes[a, 5])
    )
