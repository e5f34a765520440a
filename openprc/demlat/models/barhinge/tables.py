"""The scene as flat arrays, in the form in which compiled code takes it."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

Reals = NDArray[np.float64]
Nodes = NDArray[np.int64]


class NodeTable(NamedTuple):
    """N nodes.

    Attributes
    ----------
    mass : (N,) [kg]
    inverse_mass : (N, 3) [1/kg]
        0 on axes that are fixed or position-driven.
    drag : (N,) [kg/s]
    weight : (N, 3) [N]
        Mass times gravity.
    driven : (N, 3) bool
        Position-driven axes.
    """

    mass: Reals
    inverse_mass: Reals
    drag: Reals
    weight: Reals
    driven: NDArray[np.bool_]


class BarTable(NamedTuple):
    """M bars between nodes i and j: stiffness [N/m], relaxed length [m], damping [N*s/m]."""

    i: Nodes
    j: Nodes
    stiffness: Reals
    relaxed: Reals
    damping: Reals


class HingeTable(NamedTuple):
    """K hinges with crease j-k and wings i, l; ``rest_bend`` is the rest angle minus pi."""

    j: Nodes
    k: Nodes
    i: Nodes
    l: Nodes  # noqa: E741  the name of the literature
    stiffness: Reals
    rest_bend: Reals
    damping: Reals


class Drives(NamedTuple):
    """Which signal drives which axis of which node, one row an axis."""

    position_node: Nodes
    position_axis: Nodes
    position_signal: Nodes
    force_node: Nodes
    force_axis: Nodes
    force_signal: Nodes


class Work(NamedTuple):
    """Scratch of the integrator, made once: (N, 3) each."""

    stage_x: Reals
    stage_v: Reals
    sum_x: Reals
    sum_v: Reals
    force: Reals

    @classmethod
    def for_nodes(cls, n_nodes: int) -> Work:
        """Return scratch for `n_nodes` nodes."""
        return cls(*(np.zeros((n_nodes, 3)) for _ in cls._fields))


class FrameBuffer(NamedTuple):
    """A block of B saved frames.

    Attributes
    ----------
    x, v : (B, N, 3) [m], [m/s]
    kinetic, potential, work_in, dissipated : (B,) [J]
    """

    x: Reals
    v: Reals
    kinetic: Reals
    potential: Reals
    work_in: Reals
    dissipated: Reals

    @classmethod
    def for_frames(cls, n_frames: int, n_nodes: int) -> FrameBuffer:
        """Return a buffer for a block of `n_frames` frames."""
        shape = (n_frames, n_nodes, 3)
        return cls(np.zeros(shape), np.zeros(shape), *(np.zeros(n_frames) for _ in range(4)))
