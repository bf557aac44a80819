"""Giving the springs or triangles of a mesh to their vertices, so that all own about as many."""

from cape.kernels.jit import routine


@routine
def share_items(items, block, owned, count, most, giver, taken, seen, queue):
    """Give each item (L, m) to one of its m vertices; filled are `owned` (V, D), items by owner, and `count` (V,).

    Each goes to whoever owns least; then whoever owns more than the mean, rounded up, passes items on along the
    shortest way to one who owns less. At last as many blocks, of `block` vertices, as can let none of them own more
    than one less. `most` (V,) that each may own, `giver`, `taken`, `seen` and `queue` (V,) are room; D is the largest
    number of items at a vertex.
    """
    vertices = count.size
    count[:] = 0
    seen[:] = -1
    for item in range(items.shape[0]):
        owner = items[item, 0]
        for place in range(1, items.shape[1]):
            if count[items[item, place]] < count[owner]:
                owner = items[item, place]
        owned[owner, count[owner]] = item
        count[owner] += 1
    most[:] = (items.shape[0] + vertices - 1) // vertices
    search = 0
    for vertex in range(vertices):
        while count[vertex] > most[vertex]:
            if not pass_on(vertex, search, most, items, owned, count, giver, taken, seen, queue):
                add(1, most, 0, vertices)
            search += 1
    for start in range(0, vertices, block):
        end = min(start + block, vertices)
        add(-1, most, start, end)
        for vertex in range(start, end):
            while count[vertex] > most[start]:
                if not pass_on(vertex, search, most, items, owned, count, giver, taken, seen, queue):
                    add(1, most, start, end)
                search += 1


@routine
def add(change, most, start, end):
    """Let some vertices own more, or less."""
    for vertex in range(start, end):
        most[vertex] += change


@routine
def pass_on(vertex, search, most, items, owned, count, giver, taken, seen, queue):
    """Take one item from a vertex, in a chain that ends at one who owns less than `most` (V,); False if there is none.

    `seen` tells in which search a vertex was last reached, `giver` from whom, and `taken` with which item.
    """
    queue[0], length, head = vertex, 1, 0
    seen[vertex] = search
    while head < length:
        from_vertex = queue[head]
        head += 1
        for k in range(count[from_vertex]):
            item = owned[from_vertex, k]
            for place in range(items.shape[1]):
                to = items[item, place]
                if seen[to] == search:
                    continue
                seen[to], giver[to], taken[to] = search, from_vertex, item
                if count[to] >= most[to]:
                    queue[length] = to
                    length += 1
                    continue
                while to != vertex:
                    hand_over(taken[to], giver[to], to, owned, count)
                    to = giver[to]
                return True
    return False


@routine
def hand_over(item, giver, taker, owned, count):
    """Move an item from one owner to another."""
    place = 0
    while owned[giver, place] != item:
        place += 1
    count[giver] -= 1
    owned[giver, place] = owned[giver, count[giver]]
    owned[taker, count[taker]] = item
    count[taker] += 1
