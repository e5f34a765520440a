"""What compiled code knows of a scene's contacts, and the room that it has for them."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from openprc.demlat.contact.findings import contact_radius

if TYPE_CHECKING:
    from openprc.demlat.models.barhinge.tables import Body, State
    from openprc.schema.experiment import Experiment

Reals = NDArray[np.float64]
Counts = NDArray[np.int64]

#: Sweeps over the contacts of a step unless the experiment says otherwise.
ITERATIONS = 50
#: Overlap, in distances of contact, that counts as numerical and is undone at once.
SLOP = 1e-3
#: How much farther than they touch nodes are listed, in distances of contact.
SKIN = 0.4
#: Room at the start, for each collidable node: pairs, nodes with faces, and contacts.
ROOM = (6, 2, 2)
LEAST_ROOM = 64

#: Entries of `Lists.status`: lengths of the three lists (what they should have been,
#: where there was no room), and whether the lists are to be trusted.
PAIRS, FACINGS, NEAR, LISTED = range(4)
#: Columns of `Touch.near` besides the two that say who touches whom.
NEXT, ORDER = 2, 3
#: Columns of `Touch.record`.
SIDE, ALLOWED, CROSSED, LEVER, NORMAL, FRICTION = range(6)
RECORD_COLUMNS = FRICTION + 3


class Lists(NamedTuple):
    """Who may touch whom, in units of the engine.

    Attributes
    ----------
    distance : float [m]
        Of the centres of two nodes that touch.
    radius : float [m]
        Distance of a node from a face that it touches.
    skin : float [m]
    extent : float [m]
        Mean size of a face, the size of cells in which nodes near faces are sought.
    nodes : (C,) i8
        Collidable nodes, ascending.
    watched : (W,) i8
        Nodes whose motion can make or break a contact.
    faces : (3 F,) i8
        Corners, face after face.
    mobile : (N,) bool
        Whether any coordinate of a node can move freely.
    bond_first, bonded : (N + 1,), (2 M,) i8
        Row n of `bonded` from ``bond_first[n]`` on: the nodes that share a bar with n.
    cell : (3 C,) i8
        Of every collidable node in the grid.
    bucket, bucket_first : (C,), (B + 1,) i8
        Collidable nodes by the hash of their cells.
    pair : (room, 2) i8
        Nodes that may touch before the lists are made again.
    facing : (room, 2) i8
        Likewise nodes and faces.
    listed_at : (3 * stride,) [m]
        Positions for which the lists were made.
    reach : (1,) [m]
        Gap up to which the lists are complete at `listed_at`.
    status : (4,) i8
    """

    distance: float
    radius: float
    skin: float
    extent: float
    nodes: Counts
    watched: Counts
    faces: Counts
    mobile: NDArray[np.bool_]
    bond_first: Counts
    bonded: Counts
    cell: Counts
    bucket: Counts
    bucket_first: Counts
    pair: Counts
    facing: Counts
    listed_at: Reals
    reach: Reals
    status: Counts


class Touch(NamedTuple):
    """The contacts of a step.

    Attributes
    ----------
    distance, radius : float [m]
        As in `Lists`.
    restitution, friction : float
    iterations : int
    faces : (3 F,) i8
    near : (room, 4) i8
        Node; other node or ``-1 - face``; next contact of the node; contacts by time of impact.
    record : (room, 9)
        Side of the face; the (negative) gap that is let be; how long before the end of the
        step a node was inside another that it has passed; of a resting contact the sum of
        pushes times how far they reach back (before that, the time of impact), and of the
        pushes, normal and tangential.
    since : (N,) [s]
        How long before the end of the step a node was last hit.
    first_of : (N,) i8
        First contact of a node, -1 where there is none; taken apart after every step.
    count : (1,) i8
        Of contacts.
    """

    distance: float
    radius: float
    restitution: float
    friction: float
    iterations: int
    faces: Counts
    near: Counts
    record: Reals
    since: Reals
    first_of: Counts
    count: Counts


class ContactTable(NamedTuple):
    """Contacts of a scene.

    Attributes
    ----------
    lists : Lists
    touch : Touch
    start : (3 * stride,) [m]
        Positions at the start of the step.
    acceleration : (3 * stride,) [m/s2]
        Mean over the step without contact; before its end, the velocities at its start.
    """

    lists: Lists
    touch: Touch
    start: Reals
    acceleration: Reals


class Motion(NamedTuple):
    """Coordinates of a step, as contacts see them; fields as in `ContactTable` and `Body`."""

    stride: int
    x: Reals
    v: Reals
    inverse_mass: Reals
    start: Reals
    acceleration: Reals
    ledger: Reals


def contact_tables(
    experiment: Experiment, *, inverse_mass: Reals, stride: int, unit: float
) -> tuple[ContactTable, ...]:
    """Return the table of a scene, or nothing when nothing can touch.

    Parameters
    ----------
    experiment : Experiment
    inverse_mass : (3 * stride,)
        As in `openprc.demlat.models.barhinge.tables.Body`.
    stride : int
    unit : float [m]
        Length that counts as 1.
    """
    geometry, collision = experiment.geometry, experiment.collision
    nodes = np.flatnonzero(geometry.collidable).astype("i8")
    faces = geometry.faces if collision.faces else geometry.faces[:0]
    if not collision.enabled or len(nodes) + len(faces) < 2 or not len(nodes):
        return ()
    radius = contact_radius(experiment) / unit
    n_nodes = geometry.n_nodes
    by_axis = inverse_mass.reshape(-1, stride)[:, :n_nodes]
    corners = geometry.positions[faces]
    first, bonded = _bonds(geometry.bars.indices, n_nodes)
    rooms = [LEAST_ROOM + each * len(nodes) for each in ROOM]
    buckets = 1 << int(2 * len(nodes)).bit_length()
    flat_faces = np.array(faces, "i8").reshape(-1)
    lists = Lists(
        distance=2.0 * radius,
        radius=radius,
        skin=SKIN * 2.0 * radius,
        extent=float(np.ptp(corners, axis=1).max(axis=1).mean()) / unit if len(faces) else 0.0,
        nodes=nodes,
        watched=np.union1d(nodes, faces).astype("i8"),
        faces=flat_faces,
        mobile=(by_axis > 0.0).any(axis=0),
        bond_first=first,
        bonded=bonded,
        cell=np.zeros(3 * len(nodes), "i8"),
        bucket=np.zeros(len(nodes), "i8"),
        bucket_first=np.zeros(buckets + 1, "i8"),
        pair=np.zeros((rooms[PAIRS], 2), "i8"),
        facing=np.zeros((rooms[FACINGS], 2), "i8"),
        listed_at=np.zeros_like(inverse_mass),
        reach=np.zeros(1),
        status=np.zeros(4, "i8"),
    )
    touch = Touch(
        distance=2.0 * radius,
        radius=radius,
        restitution=1.0 if collision.restitution is None else float(collision.restitution),
        friction=float(collision.friction or 0.0),
        iterations=int(collision.iterations or ITERATIONS),
        faces=flat_faces,
        near=np.zeros((rooms[NEAR], 4), "i8"),
        record=np.zeros((rooms[NEAR], RECORD_COLUMNS)),
        since=np.zeros(n_nodes),
        first_of=np.full(n_nodes, -1, "i8"),
        count=np.zeros(1, "i8"),
    )
    zeros = np.zeros_like(inverse_mass)
    return (ContactTable(lists, touch, zeros, zeros.copy()),)


def _bonds(bars: Counts, n_nodes: int) -> tuple[Counts, Counts]:
    """Return the rows of nodes that share a bar: where each begins, and the rows."""
    both = np.concatenate([bars, bars[:, ::-1]])
    both = both[np.argsort(both[:, 0], kind="stable")]
    counts = np.bincount(both[:, 0], minlength=n_nodes)
    first = np.concatenate([[0], np.cumsum(counts)]).astype("i8")
    return first, np.ascontiguousarray(both[:, 1], "i8")


def enlarged(table: ContactTable) -> ContactTable:
    """Return `table` with room for what its `status` says had no place."""
    lists, touch = table.lists, table.touch
    rooms = [
        int(1.5 * count) + LEAST_ROOM if count > len(old) else len(old)
        for old, count in zip((lists.pair, lists.facing, touch.near), lists.status, strict=False)
    ]
    lists = lists._replace(
        pair=np.zeros((rooms[PAIRS], 2), "i8"),
        facing=np.zeros((rooms[FACINGS], 2), "i8"),
        status=np.zeros_like(lists.status),
    )
    touch = touch._replace(
        near=np.zeros((rooms[NEAR], 4), "i8"), record=np.zeros((rooms[NEAR], RECORD_COLUMNS))
    )
    return table._replace(lists=lists, touch=touch)


class Rewind:
    """What a block of frames began with, so that it can be repeated with more room.

    Parameters
    ----------
    body : Body
    state : State
    scheme : NamedTuple of work arrays
    """

    def __init__(self, body: Body, state: State, scheme: Any) -> None:
        # Without contact no block is ever repeated.
        self._live = list(_arrays((state, scheme))) if body.contacts else []
        self._saved = [array.copy() for array in self._live]

    def repeat(self, body: Body) -> Body:
        """Go back to the beginning of the block; return the body with more room."""
        for live, saved in zip(self._live, self._saved, strict=True):
            live[...] = saved
        return body._replace(contacts=tuple(enlarged(table) for table in body.contacts))


def _arrays(parts: Any) -> Any:
    if isinstance(parts, np.ndarray):
        yield parts
    elif isinstance(parts, tuple):
        for part in parts:
            yield from _arrays(part)
