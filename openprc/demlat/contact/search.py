"""Who may touch whom: cell lists, and lists with a skin that are made from them.

Nodes are put into cubic cells, the cells into buckets by a hash of their place (Teschner et
al., Optimized spatial hashing, VMV 2003), with a counting sort: the cost is linear in nodes,
whatever the size of the scene. The lists that come out reach a skin farther than contact and
stay complete until something has moved half of it (Verlet 1967, doi:10.1103/PhysRev.159.98).
They are sorted, so that a run does not depend on when they were made.
"""

from __future__ import annotations

import math
from typing import Any

from openprc.demlat.compiled.jit import jit
from openprc.demlat.contact.table import FACINGS, LISTED, NEAR, PAIRS
from openprc.demlat.contact.triangle import dot, minus, nearest_on_triangle, times, where

#: Cells beyond this are one: what is that far away has diverged.
FARTHEST_CELL = 2.0**40
#: Contacts are looked at when they could touch by moving this many times the largest
#: displacement of the step: pushes travel farther than what was pushed.
MARGIN = 4.0


@jit
def copy_to(target: Any, source: Any) -> None:
    """Copy an array; slices would need numba's run time."""
    for at in range(source.size):
        target[at] = source[at]


@jit
def _cell_along(value: float, per_cell: float) -> int:
    scaled = math.floor(value * per_cell)
    if not abs(scaled) < FARTHEST_CELL:  # also NaN
        return 0
    return int(scaled)


@jit
def _bucket_of(lists: Any, i: int, j: int, k: int) -> int:
    mixed = (i * 73856093) ^ (j * 19349663) ^ (k * 83492791)
    return mixed & (lists.bucket_first.size - 2)


@jit
def fill_cells(lists: Any, stride: int, x: Any, size: float) -> None:
    """Sort collidable nodes into cells of that size."""
    per_cell = 1.0 / size
    first, cell = lists.bucket_first, lists.cell
    first[:] = 0
    for c in range(lists.nodes.size):
        p = where(stride, x, lists.nodes[c])
        for axis in range(3):
            cell[3 * c + axis] = _cell_along(p[axis], per_cell)
        first[_bucket_of(lists, cell[3 * c], cell[3 * c + 1], cell[3 * c + 2]) + 1] += 1
    for b in range(first.size - 1):
        first[b + 1] += first[b]
    # Backwards, so that `first` ends at the beginnings and nodes in a bucket ascend.
    for c in range(lists.nodes.size - 1, -1, -1):
        b = _bucket_of(lists, cell[3 * c], cell[3 * c + 1], cell[3 * c + 2])
        first[b + 1] -= 1
        lists.bucket[first[b + 1]] = c
    for b in range(first.size - 1):
        first[b] = first[b + 1]
    first[first.size - 1] = lists.nodes.size


@jit
def _share_a_bar(lists: Any, i: int, j: int) -> bool:
    at, end = lists.bond_first[i], lists.bond_first[i + 1]
    while at < end and lists.bonded[at] != j:
        at += 1
    return at < end


@jit
def _sort_tail(rows: Any, begin: int, end: int) -> None:
    """Sort the second column of a few rows."""
    for at in range(begin + 1, end):
        value = rows[at, 1]
        back = at - 1
        while back >= begin and rows[back, 1] > value:
            rows[back + 1, 1] = rows[back, 1]
            back -= 1
        rows[back + 1, 1] = value


@jit
def list_pairs(lists: Any, stride: int, x: Any, reach: float) -> None:
    """List collidable nodes with a gap below `reach`, ascending by both."""
    far = lists.distance + reach
    fill_cells(lists, stride, x, far)
    cell, first = lists.cell, lists.bucket_first
    lists.status[PAIRS] = 0
    for c in range(lists.nodes.size):
        i, begin = lists.nodes[c], lists.status[PAIRS]
        p = where(stride, x, i)
        for neighbour in range(27):
            at = (
                cell[3 * c] + neighbour % 3 - 1,
                cell[3 * c + 1] + (neighbour // 3) % 3 - 1,
                cell[3 * c + 2] + neighbour // 9 - 1,
            )
            b = _bucket_of(lists, at[0], at[1], at[2])
            for entry in range(first[b], first[b + 1]):
                d = lists.bucket[entry]
                if d <= c or cell[3 * d] != at[0]:
                    continue
                if cell[3 * d + 1] != at[1] or cell[3 * d + 2] != at[2]:
                    continue  # another cell with the same hash
                j = lists.nodes[d]
                apart = minus(where(stride, x, j), p)
                if not dot(apart, apart) < far * far:
                    continue
                if not (lists.mobile[i] or lists.mobile[j]) or _share_a_bar(lists, i, j):
                    continue
                at_end = lists.status[PAIRS]
                if at_end < lists.pair.shape[0]:
                    lists.pair[at_end, 0] = i
                    lists.pair[at_end, 1] = j
                lists.status[PAIRS] += 1
        if lists.status[PAIRS] <= lists.pair.shape[0]:
            _sort_tail(lists.pair, begin, lists.status[PAIRS])


@jit
def squared_distance(lists: Any, stride: int, x: Any, node: int, face: int) -> float:
    """Return the square of the distance of a node from a face [m2]."""
    p = where(stride, x, node)
    a = where(stride, x, lists.faces[3 * face])
    b = where(stride, x, lists.faces[3 * face + 1])
    c = where(stride, x, lists.faces[3 * face + 2])
    u, v, w, _ = nearest_on_triangle(p, a, b, c)
    apart = minus(minus(minus(p, times(a, u)), times(b, v)), times(c, w))
    return dot(apart, apart)


@jit
def _list_facing(lists: Any, stride: int, x: Any, c: int, face: int, far: float) -> None:
    """Append collidable node number `c` and `face` if they are near."""
    node = lists.nodes[c]
    i, j, k = lists.faces[3 * face], lists.faces[3 * face + 1], lists.faces[3 * face + 2]
    if node in (i, j, k):
        return
    mobile = lists.mobile
    if not (mobile[node] or mobile[i] or mobile[j] or mobile[k]):
        return
    if not squared_distance(lists, stride, x, node, face) < far * far:
        return
    at_end = lists.status[FACINGS]
    if at_end < lists.facing.shape[0]:
        lists.facing[at_end, 0] = node
        lists.facing[at_end, 1] = face
    lists.status[FACINGS] += 1


@jit
def list_facings(lists: Any, stride: int, x: Any, reach: float) -> None:
    """List collidable nodes and faces with a gap below `reach`, face after face."""
    n_faces = lists.faces.size // 3
    lists.status[FACINGS] = 0
    if n_faces > 0:
        far = lists.radius + reach
        size = max(far, lists.extent)
        fill_cells(lists, stride, x, size)
        cell, first = lists.cell, lists.bucket_first
        for face in range(n_faces):
            i, j, k = lists.faces[3 * face], lists.faces[3 * face + 1], lists.faces[3 * face + 2]
            a, b, c = where(stride, x, i), where(stride, x, j), where(stride, x, k)
            low_x = _cell_along(min(a[0], b[0], c[0]) - far, 1.0 / size)
            low_y = _cell_along(min(a[1], b[1], c[1]) - far, 1.0 / size)
            low_z = _cell_along(min(a[2], b[2], c[2]) - far, 1.0 / size)
            high_x = _cell_along(max(a[0], b[0], c[0]) + far, 1.0 / size)
            high_y = _cell_along(max(a[1], b[1], c[1]) + far, 1.0 / size)
            high_z = _cell_along(max(a[2], b[2], c[2]) + far, 1.0 / size)
            cells = float(high_x - low_x + 1) * float(high_y - low_y + 1)
            cells *= float(high_z - low_z + 1)
            if cells > lists.nodes.size:
                for other in range(lists.nodes.size):
                    _list_facing(lists, stride, x, other, face, far)
                continue
            for at_x in range(low_x, high_x + 1):
                for at_y in range(low_y, high_y + 1):
                    for at_z in range(low_z, high_z + 1):
                        hashed = _bucket_of(lists, at_x, at_y, at_z)
                        for entry in range(first[hashed], first[hashed + 1]):
                            other = lists.bucket[entry]
                            if (
                                cell[3 * other] == at_x
                                and cell[3 * other + 1] == at_y
                                and cell[3 * other + 2] == at_z
                            ):
                                _list_facing(lists, stride, x, other, face, far)


@jit
def largest_move(lists: Any, stride: int, x: Any, before: Any) -> float:
    """Return how far the watched node that moved most is from where it was [m]."""
    largest = 0.0
    for w in range(lists.watched.size):
        node = lists.watched[w]
        apart = minus(where(stride, x, node), where(stride, before, node))
        largest = max(largest, dot(apart, apart))
    return math.sqrt(largest)


@jit
def keep_lists(lists: Any, stride: int, x: Any, margin: float) -> bool:
    """Make the lists again where they may miss a gap below `margin`; say whether they fit."""
    moved = largest_move(lists, stride, x, lists.listed_at)
    if lists.status[LISTED] == 1 and 2.0 * moved + margin <= lists.reach[0]:
        return True
    reach = max(lists.skin, 2.0 * margin)
    list_pairs(lists, stride, x, reach)
    list_facings(lists, stride, x, reach)
    lists.status[LISTED] = 0
    if lists.status[PAIRS] > lists.pair.shape[0] or lists.status[FACINGS] > lists.facing.shape[0]:
        return False
    copy_to(lists.listed_at, x)
    lists.reach[0] = reach
    lists.status[LISTED] = 1
    return True


@jit
def _append(touch: Any, node: int, other: int) -> None:
    at_end = touch.count[0]
    if at_end < touch.near.shape[0]:
        touch.near[at_end, 0] = node
        touch.near[at_end, 1] = other
    touch.count[0] += 1


@jit
def gather(lists: Any, touch: Any, stride: int, x: Any, margin: float) -> bool:
    """Put contacts with a gap below `margin` into `near`; say whether they fit."""
    touch.count[0] = 0
    far = touch.distance + margin
    for at in range(lists.status[PAIRS]):
        i, j = lists.pair[at, 0], lists.pair[at, 1]
        apart = minus(where(stride, x, i), where(stride, x, j))
        if dot(apart, apart) < far * far:
            _append(touch, i, j)
    far = touch.radius + margin
    for at in range(lists.status[FACINGS]):
        node, face = lists.facing[at, 0], lists.facing[at, 1]
        if squared_distance(lists, stride, x, node, face) < far * far:
            _append(touch, node, -1 - face)
    lists.status[NEAR] = touch.count[0]
    return touch.count[0] <= touch.near.shape[0]
