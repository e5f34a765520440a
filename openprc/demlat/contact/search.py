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
def _cell_along(value: float, per_cell: float) -> int:
    scaled = math.floor(value * per_cell)
    if not abs(scaled) < FARTHEST_CELL:  # also NaN
        return 0
    return int(scaled)


@jit
def _bucket_of(table: Any, i: int, j: int, k: int) -> int:
    mixed = (i * 73856093) ^ (j * 19349663) ^ (k * 83492791)
    return mixed & (table.bucket_first.size - 2)


@jit
def fill_cells(table: Any, body: Any, x: Any, size: float) -> None:
    """Sort collidable nodes into cells of that size."""
    per_cell = 1.0 / size
    first, cell = table.bucket_first, table.cell
    first[:] = 0
    for c in range(table.nodes.size):
        p = where(body, x, table.nodes[c])
        for axis in range(3):
            cell[3 * c + axis] = _cell_along(p[axis], per_cell)
        first[_bucket_of(table, cell[3 * c], cell[3 * c + 1], cell[3 * c + 2]) + 1] += 1
    for b in range(first.size - 1):
        first[b + 1] += first[b]
    # Backwards, so that `first` ends at the beginnings and nodes in a bucket ascend.
    for c in range(table.nodes.size - 1, -1, -1):
        b = _bucket_of(table, cell[3 * c], cell[3 * c + 1], cell[3 * c + 2])
        first[b + 1] -= 1
        table.bucket[first[b + 1]] = c
    for b in range(first.size - 1):
        first[b] = first[b + 1]
    first[first.size - 1] = table.nodes.size


@jit
def _share_a_bar(table: Any, i: int, j: int) -> bool:
    for at in range(table.bond_first[i], table.bond_first[i + 1]):
        if table.bonded[at] == j:
            return True
    return False


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
def list_pairs(table: Any, body: Any, x: Any, reach: float) -> None:
    """List collidable nodes with a gap below `reach`, ascending by both."""
    far = table.distance + reach
    fill_cells(table, body, x, far)
    cell, first, count = table.cell, table.bucket_first, 0
    for c in range(table.nodes.size):
        i, begin = table.nodes[c], count
        p = where(body, x, i)
        for neighbour in range(27):
            at = (
                cell[3 * c] + neighbour % 3 - 1,
                cell[3 * c + 1] + (neighbour // 3) % 3 - 1,
                cell[3 * c + 2] + neighbour // 9 - 1,
            )
            b = _bucket_of(table, at[0], at[1], at[2])
            for entry in range(first[b], first[b + 1]):
                d = table.bucket[entry]
                if d <= c or cell[3 * d] != at[0]:
                    continue
                if cell[3 * d + 1] != at[1] or cell[3 * d + 2] != at[2]:
                    continue  # another cell with the same hash
                j = table.nodes[d]
                apart = minus(where(body, x, j), p)
                if not dot(apart, apart) < far * far:
                    continue
                if not (table.mobile[i] or table.mobile[j]) or _share_a_bar(table, i, j):
                    continue
                if count < table.pair.shape[0]:
                    table.pair[count, 0] = i
                    table.pair[count, 1] = j
                count += 1
        if count <= table.pair.shape[0]:
            _sort_tail(table.pair, begin, count)
    table.status[PAIRS] = count


@jit
def _list_facing(table: Any, body: Any, x: Any, c: int, face: int, far: float, count: int) -> int:
    """Append collidable node number `c` and `face` if they are near; return the new count."""
    node = table.nodes[c]
    i, j, k = table.faces[3 * face], table.faces[3 * face + 1], table.faces[3 * face + 2]
    if node == i or node == j or node == k:
        return count
    mobile = table.mobile
    if not (mobile[node] or mobile[i] or mobile[j] or mobile[k]):
        return count
    p, at_i, at_j, at_k = (
        where(body, x, node),
        where(body, x, i),
        where(body, x, j),
        where(body, x, k),
    )
    u, v, w, _ = nearest_on_triangle(p, at_i, at_j, at_k)
    apart = minus(minus(minus(p, times(at_i, u)), times(at_j, v)), times(at_k, w))
    if not dot(apart, apart) < far * far:
        return count
    if count < table.facing.shape[0]:
        table.facing[count, 0] = node
        table.facing[count, 1] = face
    return count + 1


@jit
def list_facings(table: Any, body: Any, x: Any, reach: float) -> None:
    """List collidable nodes and faces with a gap below `reach`, face after face."""
    n_faces, count = table.faces.size // 3, 0
    if n_faces > 0:
        far = table.radius + reach
        size = max(far, table.extent)
        fill_cells(table, body, x, size)
        cell, first = table.cell, table.bucket_first
        for face in range(n_faces):
            i, j, k = table.faces[3 * face], table.faces[3 * face + 1], table.faces[3 * face + 2]
            a, b, c = where(body, x, i), where(body, x, j), where(body, x, k)
            low_x = _cell_along(min(a[0], b[0], c[0]) - far, 1.0 / size)
            low_y = _cell_along(min(a[1], b[1], c[1]) - far, 1.0 / size)
            low_z = _cell_along(min(a[2], b[2], c[2]) - far, 1.0 / size)
            high_x = _cell_along(max(a[0], b[0], c[0]) + far, 1.0 / size)
            high_y = _cell_along(max(a[1], b[1], c[1]) + far, 1.0 / size)
            high_z = _cell_along(max(a[2], b[2], c[2]) + far, 1.0 / size)
            cells = float(high_x - low_x + 1) * float(high_y - low_y + 1)
            cells *= float(high_z - low_z + 1)
            if cells > table.nodes.size:
                for other in range(table.nodes.size):
                    count = _list_facing(table, body, x, other, face, far, count)
                continue
            for at_x in range(low_x, high_x + 1):
                for at_y in range(low_y, high_y + 1):
                    for at_z in range(low_z, high_z + 1):
                        hashed = _bucket_of(table, at_x, at_y, at_z)
                        for entry in range(first[hashed], first[hashed + 1]):
                            other = table.bucket[entry]
                            if (
                                cell[3 * other] == at_x
                                and cell[3 * other + 1] == at_y
                                and cell[3 * other + 2] == at_z
                            ):
                                count = _list_facing(table, body, x, other, face, far, count)
    table.status[FACINGS] = count


@jit
def largest_move(table: Any, body: Any, x: Any, before: Any) -> float:
    """Return how far the watched node that moved most is from where it was [m]."""
    largest = 0.0
    for w in range(table.watched.size):
        node = table.watched[w]
        apart = minus(where(body, x, node), where(body, before, node))
        largest = max(largest, dot(apart, apart))
    return math.sqrt(largest)


@jit
def keep_lists(table: Any, body: Any, x: Any, margin: float) -> bool:
    """Make the lists again where they may miss a gap below `margin`; say whether they fit."""
    moved = largest_move(table, body, x, table.listed_at)
    if table.status[LISTED] == 1 and 2.0 * moved + margin <= table.reach[0]:
        return True
    reach = max(table.skin, 2.0 * margin)
    list_pairs(table, body, x, reach)
    list_facings(table, body, x, reach)
    table.status[LISTED] = 0
    if table.status[PAIRS] > table.pair.shape[0] or table.status[FACINGS] > table.facing.shape[0]:
        return False
    table.listed_at[:] = x
    table.reach[0] = reach
    table.status[LISTED] = 1
    return True


@jit
def _append(table: Any, count: int, node: int, other: int) -> int:
    if count < table.near.shape[0]:
        table.near[count, 0] = node
        table.near[count, 1] = other
    return count + 1


@jit
def gather(table: Any, body: Any, x: Any, margin: float) -> bool:
    """Put contacts with a gap below `margin` into `near`; say whether they fit."""
    count, far = 0, table.distance + margin
    for at in range(table.status[PAIRS]):
        i, j = table.pair[at, 0], table.pair[at, 1]
        apart = minus(where(body, x, i), where(body, x, j))
        if dot(apart, apart) < far * far:
            count = _append(table, count, i, j)
    far = table.radius + margin
    for at in range(table.status[FACINGS]):
        node, face = table.facing[at, 0], table.facing[at, 1]
        p = where(body, x, node)
        a = where(body, x, table.faces[3 * face])
        b = where(body, x, table.faces[3 * face + 1])
        c = where(body, x, table.faces[3 * face + 2])
        u, v, w, _ = nearest_on_triangle(p, a, b, c)
        apart = minus(minus(minus(p, times(a, u)), times(b, v)), times(c, w))
        if dot(apart, apart) < far * far:
            count = _append(table, count, node, -1 - face)
    table.status[NEAR] = count
    return count <= table.near.shape[0]
