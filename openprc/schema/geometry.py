"""The body of an experiment: nodes, bars, hinges, bends and faces, as frozen records."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

BarLaw = Literal["linear", "cubic", "cable", "strut", "ogden"]
BAR_LAWS: tuple[BarLaw, ...] = get_args(BarLaw)
HingeLaw = Literal["linear", "enhanced-linear", "four-thirds"]
HINGE_LAWS: tuple[HingeLaw, ...] = get_args(HingeLaw)
FULL_TURN = 2.0 * math.pi
#: Default of columns that are filled in once the number of rows is known.
_FILLED: Any = None


def _frozen(values: ArrayLike, dtype: str, shape: tuple[int, ...]) -> NDArray[Any]:
    """Return a read-only copy, so that no producer can change what another one is given.

    Wrong shapes pass through for the checks to report; an empty list gets its second axis.
    """
    array = np.array(values, dtype=dtype)
    if array.size == 0 and array.ndim == 1 and len(shape) == 2:
        array = array.reshape(0, shape[1])
    array.flags.writeable = False
    return array


def _freeze(record: object, **columns: tuple[str, tuple[int, ...]]) -> None:
    for name, (dtype, shape) in columns.items():
        object.__setattr__(record, name, _frozen(getattr(record, name), dtype, shape))


def _fill(record: object, count: int, **defaults: object) -> None:
    for name, value in defaults.items():
        if getattr(record, name) is None:
            object.__setattr__(record, name, np.full(count, value))


@dataclass(frozen=True, kw_only=True, eq=False)
class Bars:
    """Two-node axial elements.

    Parameters
    ----------
    indices : (M, 2) [node]
    stiffness : (M,) [N/m]
        Of the spring on the length, at the relaxed length.
    rest_length : (M,) [m]
    damping : (M,) [N*s/m], default 0
        Dashpot on the rate of the length; conserves momentum. (A ratio [1] where
        ``Experiment.bar_damping`` is "printed".)
    prestress : (M,) [1], default 0
        The spring is relaxed at ``rest_length * (1 + prestress)``.
    rigid : (M,) bool, default False
        The length is a constraint, and `stiffness` has no meaning.
    law : (M,) str, default "linear"
        With stretch ``s = l - relaxed``, rate ``r = dl/dt`` and strain ``e = s / relaxed``:
        "linear" ``k s + c r``; "cubic" ``k s + k3 s^3 + c r + c3 r^3`` (Hauser et al. 2011,
        doi:10.1007/s00422-012-0471-0); "cable" and "strut", linear while longer, or shorter,
        than relaxed and slack otherwise; "ogden" ``k relaxed ((1 + e)^4 - 1) / 4 + c r``
        (Liu & Paulino 2017, doi:10.1098/rspa.2017.0348, exponents 5 and 1).
    stiffness_cubic : (M,) [N/m3], default 0
        k3 of the law "cubic".
    damping_cubic : (M,) [N*s3/m3], default 0
        c3 of the law "cubic".
    """

    indices: NDArray[np.int32] = field(default_factory=lambda: np.zeros((0, 2), "i4"))
    stiffness: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    rest_length: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    damping: NDArray[np.float64] = _FILLED
    prestress: NDArray[np.float64] = _FILLED
    rigid: NDArray[np.bool_] = _FILLED
    law: NDArray[np.str_] = _FILLED
    stiffness_cubic: NDArray[np.float64] = _FILLED
    damping_cubic: NDArray[np.float64] = _FILLED

    def __post_init__(self) -> None:
        _fill(self, len(self.indices), damping=0.0, prestress=0.0, rigid=False, law="linear")
        _fill(self, len(self.indices), stiffness_cubic=0.0, damping_cubic=0.0)
        number = ("f8", (-1,))
        _freeze(self, indices=("i4", (-1, 2)), rigid=("?", (-1,)), law=("U16", (-1,)))
        _freeze(self, stiffness=number, rest_length=number, damping=number, prestress=number)
        _freeze(self, stiffness_cubic=number, damping_cubic=number)

    def __len__(self) -> int:
        """Return the number of bars."""
        return len(self.indices)

    @property
    def relaxed_length(self) -> NDArray[np.float64]:
        """``rest_length * (1 + prestress)``, the length without force: (M,) [m]."""
        return self.rest_length * (1.0 + self.prestress)


@dataclass(frozen=True, kw_only=True, eq=False)
class Hinges:
    """Four-node elements on the dihedral angle between two triangles.

    Parameters
    ----------
    indices : (K, 4) [node]
        ``[j, k, i, l]``: the crease j-k first, then the wings i and l.
    stiffness : (K,) [N*m/rad]
    rest_angle : (K,) [rad]
        pi is flat, 0 is folded shut.
    damping : (K,) [N*m*s/rad], default 0
    rigid : (K,) bool, default False
        The angle is a constraint, and `stiffness` has no meaning.
    law : (K,) str, default "linear"
        "linear" ``k (angle - rest)``; "enhanced-linear" the same between the limits, and
        beyond them a moment that grows without bound towards 0 and 2 pi, so that panels do
        not pass through each other (Liu & Paulino 2017, doi:10.1098/rspa.2017.0348);
        "four-thirds" ``k sign(d) |d|^(4/3)`` with ``d = angle - rest``, a panel that bends
        (`stiffness` is the moment at 1 rad; for quasi-static runs).
    limit_low, limit_high : (K,) [rad], default 0 and 2 pi
        For "enhanced-linear" where the linear range ends; for "linear" hard stops, which
        only integrators that project constraints can model.
    """

    indices: NDArray[np.int32] = field(default_factory=lambda: np.zeros((0, 4), "i4"))
    stiffness: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    rest_angle: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    damping: NDArray[np.float64] = _FILLED
    rigid: NDArray[np.bool_] = _FILLED
    law: NDArray[np.str_] = _FILLED
    limit_low: NDArray[np.float64] = _FILLED
    limit_high: NDArray[np.float64] = _FILLED

    def __post_init__(self) -> None:
        _fill(self, len(self.indices), damping=0.0, rigid=False, law="linear")
        _fill(self, len(self.indices), limit_low=0.0, limit_high=FULL_TURN)
        number = ("f8", (-1,))
        _freeze(self, indices=("i4", (-1, 4)), rigid=("?", (-1,)), law=("U16", (-1,)))
        _freeze(self, stiffness=number, rest_angle=number, damping=number)
        _freeze(self, limit_low=number, limit_high=number)

    def __len__(self) -> int:
        """Return the number of hinges."""
        return len(self.indices)

    @property
    def limited(self) -> NDArray[np.bool_]:
        """Which hinges have limits: (K,) bool."""
        return (self.limit_low > 0.0) | (self.limit_high < FULL_TURN)


@dataclass(frozen=True, kw_only=True, eq=False)
class Bends:
    """Three-node elements on the angle between two arms: bending springs of chains and rods.

    The angle lies in [0, pi], pi is straight and 0 folded back; the torque is
    ``k (angle - rest_angle) + c d(angle)/dt``. A chain of bars with a bend at every inner node
    is the bar form of an unshearable rod (``k = E I / l`` for segments of length l).

    Parameters
    ----------
    indices : (B, 3) [node]
        ``[end, vertex, end]``.
    stiffness : (B,) [N*m/rad]
    rest_angle : (B,) [rad], default pi
        In (0, pi]. Below pi the element cannot pass through straight, where the side that it
        bends to is not defined.
    damping : (B,) [N*m*s/rad], default 0
        Dashpot on the rate of the angle.
    """

    indices: NDArray[np.int32] = field(default_factory=lambda: np.zeros((0, 3), "i4"))
    stiffness: NDArray[np.float64] = field(default_factory=lambda: np.zeros(0))
    rest_angle: NDArray[np.float64] = _FILLED
    damping: NDArray[np.float64] = _FILLED

    def __post_init__(self) -> None:
        _fill(self, len(self.indices), rest_angle=math.pi, damping=0.0)
        number = ("f8", (-1,))
        _freeze(self, indices=("i4", (-1, 3)))
        _freeze(self, stiffness=number, rest_angle=number, damping=number)

    def __len__(self) -> int:
        """Return the number of bends."""
        return len(self.indices)


@dataclass(frozen=True, kw_only=True, eq=False)
class Geometry:
    """Nodes and the elements between them.

    Parameters
    ----------
    positions : (N, 3) [m]
        At t = 0.
    masses : (N,) [kg]
    fixed : (N,) bool, default False
        Fixed nodes never move.
    collidable : (N,) bool, default False
    velocities : (N, 3) [m/s], default 0
        At t = 0.
    labels : tuple of N str, optional
        What matches nodes across producers.
    bars : Bars
    hinges : Hinges
    bends : Bends
    faces : (F, 3) [node]
        Triangles without mechanics, for display.
    """

    positions: NDArray[np.float64]
    masses: NDArray[np.float64]
    fixed: NDArray[np.bool_] = _FILLED
    collidable: NDArray[np.bool_] = _FILLED
    velocities: NDArray[np.float64] = _FILLED
    labels: tuple[str, ...] | None = None
    bars: Bars = field(default_factory=Bars)
    hinges: Hinges = field(default_factory=Hinges)
    bends: Bends = field(default_factory=Bends)
    faces: NDArray[np.int32] = field(default_factory=lambda: np.zeros((0, 3), "i4"))

    def __post_init__(self) -> None:
        _freeze(self, positions=("f8", (-1, 3)), masses=("f8", (-1,)), faces=("i4", (-1, 3)))
        _fill(self, len(self.positions), fixed=False, collidable=False)
        if self.velocities is None:
            object.__setattr__(self, "velocities", np.zeros_like(self.positions))
        _freeze(self, fixed=("?", (-1,)), collidable=("?", (-1,)), velocities=("f8", (-1, 3)))

    @property
    def n_nodes(self) -> int:
        """Number of nodes."""
        return len(self.positions)
