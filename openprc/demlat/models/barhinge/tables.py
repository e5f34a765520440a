"""The scene as flat arrays, in the form in which compiled code takes it.

Elements come in groups of one law and one way of access. A group's work is cut into blocks of
as many elements as its template `lanes` has lanes (see `openprc.demlat.compiled.lanes`); its
parameters stand block after block, and `element` says which element of the geometry a lane is,
-1 where it only fills up the block. What a scene does not have is None, and compiled away.

Coordinates are flat: axis a of place p is at ``a * stride + p``.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]
Places = NDArray[np.int32]
Lanes = tuple[float, ...]

#: Rows of the power and energy ledgers: what actuators put in, and what each loss takes.
LEDGER = ("work_in", "drag", "bars", "hinges", "contact")
WORK_IN, DRAG, BARS, HINGES, CONTACT = range(5)
#: One more row, in scenes that have bends.
BENDS = len(LEDGER)
#: Rows of energies: kinetic, of bars, of hinges, of weight, of bends.
ENERGY_ROWS = 5
BEND_ENERGY = 4
#: Between the rows; each group of elements uses as many columns as it has lanes.
LEDGER_STRIDE = 16


def ledger_size(*, with_bends: bool) -> int:
    """Return how many numbers a ledger has."""
    return (len(LEDGER) + with_bends) * LEDGER_STRIDE


class LinearBars(NamedTuple):
    """B blocks of bars with a linear spring.

    Attributes
    ----------
    lanes : template
    element : (B * width,) i4
    i, j : (B,) or (B, width) i4
        Places of the ends.
    stiffness, relaxed, damping : (B * width,) [N/m], [m], [N*s/m]
        `damping` is None where no bar of the group has any.
    offset : None or four arrays (B * width,) or (B, 1) [m], [m], [m], [m2]
        In displacement form: the vector from i to j in the reference state, and its square
        minus the square of `relaxed`; (B, 1) where all scenes of an ensemble share it.
    """

    lanes: Lanes
    element: Places
    i: Places
    j: Places
    stiffness: Reals
    relaxed: Reals
    damping: Reals | None
    offset: tuple[Reals, ...] | None


class Cables(NamedTuple):
    """Bars that only pull; fields as in `LinearBars`."""

    lanes: Lanes
    element: Places
    i: Places
    j: Places
    stiffness: Reals
    relaxed: Reals
    damping: Reals | None
    offset: tuple[Reals, ...] | None


class Struts(NamedTuple):
    """Bars that only push; fields as in `LinearBars`."""

    lanes: Lanes
    element: Places
    i: Places
    j: Places
    stiffness: Reals
    relaxed: Reals
    damping: Reals | None
    offset: tuple[Reals, ...] | None


class OgdenBars(NamedTuple):
    """Bars of an Ogden material; fields as in `LinearBars`."""

    lanes: Lanes
    element: Places
    i: Places
    j: Places
    stiffness: Reals
    relaxed: Reals
    damping: Reals | None
    offset: tuple[Reals, ...] | None


class CubicBars(NamedTuple):
    """Bars with cubic spring [N/m3] and dashpot [N*s3/m3]; else as in `LinearBars`."""

    lanes: Lanes
    element: Places
    i: Places
    j: Places
    stiffness: Reals
    relaxed: Reals
    damping: Reals | None
    offset: tuple[Reals, ...] | None
    stiffness_cubic: Reals
    damping_cubic: Reals


class PrintedDampers(NamedTuple):
    """Dampers on the whole relative velocity, with a coefficient [kg/s] for each end."""

    lanes: Lanes
    element: Places
    i: Places
    j: Places
    drag_i: Reals
    drag_j: Reals


class LinearHinges(NamedTuple):
    """B blocks of hinges with crease j-k and wings i, l.

    Attributes
    ----------
    lanes, element
        As in `LinearBars`.
    j, k, i, l : (B,) or (B, width) i4
    stiffness, damping : (B * width,) [N*m/rad], [N*m*s/rad]
        `damping` is None where no hinge of the group has any.
    sine, cosine : (B * width,)
        Of the rest bend, which is the rest angle minus pi.
    offset : None or nine arrays (B * width,) or (B, 1) [m]
        In displacement form: the vectors j to i, j to k and l to k in the reference state.
    """

    lanes: Lanes
    element: Places
    j: Places
    k: Places
    i: Places
    l: Places  # noqa: E741  the name of the literature
    stiffness: Reals
    sine: Reals
    cosine: Reals
    damping: Reals | None
    offset: tuple[Reals, ...] | None


class WalledHinges(NamedTuple):
    """Enhanced-linear hinges: between limits as `LinearHinges`, beyond them a steep wall.

    Attributes
    ----------
    sine, cosine : (B * width,)
        0 and 1: the bend itself is measured.
    rest_bend : (B * width,) [rad]
        In [-pi, pi].
    low, high : (B * width,) [rad]
        Limits of the bend minus the rest bend.
    low_room, high_room : (B * width,) [rad]
        From a limit to where the panels meet.
    """

    lanes: Lanes
    element: Places
    j: Places
    k: Places
    i: Places
    l: Places  # noqa: E741
    stiffness: Reals
    sine: Reals
    cosine: Reals
    damping: Reals | None
    offset: tuple[Reals, ...] | None
    rest_bend: Reals
    low: Reals
    high: Reals
    low_room: Reals
    high_room: Reals


class LinearBends(NamedTuple):
    """B blocks of bends with vertex j and ends i, k.

    Attributes
    ----------
    lanes, element
        As in `LinearBars`.
    i, j, k : (B,) or (B, width) i4
    stiffness, damping : (B * width,) [N*m/rad], [N*m*s/rad]
        `damping` is None where no bend of the group has any.
    rest_turn : (B * width,) [rad]
        Pi minus the rest angle: 0 where straight is at rest.
    offset : None or six arrays (B * width,) or (B, 1) [m]
        In displacement form: the arm j to i in the reference state, and the sum of both arms.
    """

    lanes: Lanes
    element: Places
    i: Places
    j: Places
    k: Places
    stiffness: Reals
    rest_turn: Reals
    damping: Reals | None
    offset: tuple[Reals, ...] | None


class Drives(NamedTuple):
    """Which signal drives which coordinate, one row a coordinate (and lane).

    Attributes
    ----------
    signals : SignalTable
    motion_at, force_at : (P,), (Q,) i8
        Flat coordinates whose motion is prescribed, and to which a force is added.
    motion_signal, force_signal : (P,), (Q,) i8
        Columns of the signal table.
    motion_start : (P,) [m]
        Added to the signal: the start of a coordinate whose velocity is prescribed, else 0.
    motion_mass, motion_drag, motion_weight : (P,) [kg], [kg/s], [N]
    motion_lane, force_lane : (P,), (Q,) i8
        The scene of an ensemble that the row belongs to.
    """

    signals: Any
    motion_at: NDArray[np.int64]
    motion_signal: NDArray[np.int64]
    motion_start: Reals
    motion_mass: Reals
    motion_drag: Reals
    motion_weight: Reals
    motion_lane: NDArray[np.int64]
    force_at: NDArray[np.int64]
    force_signal: NDArray[np.int64]
    force_lane: NDArray[np.int64]


class Body(NamedTuple):
    """Everything that gives forces.

    Attributes
    ----------
    lanes : template
        For loops over coordinates.
    space : (0,) * dims
        Carries the number of dimensions in its type.
    stride : int
        Of an axis in the flat coordinates.
    inverse_mass : (dims * stride,) [1/kg]
        0 where the motion is prescribed, and in the padding.
    drag : None or (dims * stride,) [kg/s]
        0 where the motion is prescribed.
    weight : None or (dims * stride,) [N]
        Likewise.
    bars, hinges : tuple of groups
    bends : tuple of groups
        Empty where the scene has none, else at least one.
    drives : Drives or None
    contacts : tuple of at most one `openprc.demlat.contact.table.ContactTable`
    constraints : ConstraintTable or None
    mass, full_weight : (dims * stride,) [kg], [N]
        Of all coordinates, for energies.
    scratch : seven arrays (M,), (M,), (K,), (K,), (K,), (E,), (E,)
        Lengths, tensions, angles minus rest angles and moments of the last `observe`, and the
        rest angles; turns (pi minus the angle) and moments of bends.
    """

    lanes: Lanes
    space: tuple[int, ...]
    stride: int
    inverse_mass: Reals
    drag: Reals | None
    weight: Reals | None
    bars: tuple[Any, ...]
    hinges: tuple[Any, ...]
    bends: tuple[Any, ...]
    drives: Drives | None
    contacts: tuple[Any, ...]
    constraints: Any
    mass: Reals
    full_weight: Reals
    scratch: tuple[Reals, Reals, Reals, Reals, Reals, Reals, Reals]


class State(NamedTuple):
    """What the integrator advances.

    Attributes
    ----------
    x, v : (dims * stride,) [m], [m/s]
    ledger : (5 or 6 * LEDGER_STRIDE,) [J], or None
        Rows as in `LEDGER`, then that of bends; the columns add up.
    """

    x: Reals
    v: Reals
    ledger: Reals | None


class FrameBuffer(NamedTuple):
    """A block of B saved frames.

    Attributes
    ----------
    x, v : (B, N, dims) [m], [m/s]
    length, tension : (B, M) [m], [N]
    angle, moment : (B, K) [rad], [N*m]
    energy : (B, 4 or 5) [J]
        Kinetic, of bars, of hinges, of weight; of bends where there are any.
    ledger : (B, 5 or 6) [J]
        As in `LEDGER`, and what bends take, since t = 0.
    bend_angle, bend_moment : (B, E) [rad], [N*m]
    """

    x: Reals
    v: Reals
    length: Reals
    tension: Reals
    angle: Reals
    moment: Reals
    energy: Reals
    ledger: Reals
    bend_angle: Reals = np.zeros((0, 0))
    bend_moment: Reals = np.zeros((0, 0))

    @classmethod
    def for_frames(
        cls, n_frames: int, *, n_nodes: int, dims: int, n_bars: int, n_hinges: int, n_bends: int = 0
    ) -> FrameBuffer:
        """Return a buffer for a block of `n_frames` frames."""
        nodes = (n_frames, n_nodes, dims)
        with_bends = n_bends > 0
        ledger = ledger_size(with_bends=with_bends) // LEDGER_STRIDE
        widths = (n_bars, n_bars, n_hinges, n_hinges, 4 + with_bends, ledger, n_bends, n_bends)
        return cls(np.zeros(nodes), np.zeros(nodes), *(np.zeros((n_frames, w)) for w in widths))
