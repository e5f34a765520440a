"""Deviations of lengths and angles: they do not depend on where the body lies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.schema.bend_angle import bend_angles
from openprc.schema.dihedral import dihedral_angles

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.compare.alignment.node_matching import NodeMatch
    from openprc.schema.trajectory import Trajectory

    Reals = NDArray[np.float64]

KINDS = {"bars": "length", "bends": "angle", "hinges": "angle"}


@dataclass(frozen=True)
class ElementError:
    """How far elements of one kind are apart.

    Parameters
    ----------
    kind, quantity : str
        Such as "bars" and "length".
    unit : str
    rms, largest : float
    largest_element : int
        Its number in the reference.
    n_elements : int
        Elements whose nodes are all matched.
    """

    kind: str
    quantity: str
    unit: str
    rms: float
    largest: float
    largest_element: int
    n_elements: int

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON output."""
        return dict(self.__dict__)


class ElementSums:
    """Sums over elements of the reference, computed from the places in both files.

    Parameters
    ----------
    reference : Trajectory
    match : NodeMatch
    dims : int
        Hinges need three.
    unit : str
        Of the comparison.
    """

    def __init__(self, reference: Trajectory, match: NodeMatch, *, dims: int, unit: str) -> None:
        where = np.full(reference.n_nodes, -1)
        where[match.reference] = np.arange(len(match.reference))
        self._unit = unit
        self._tables: dict[str, tuple[NDArray[np.intp], NDArray[np.intp]]] = {}
        self._sums: dict[str, Reals] = {}
        for kind in KINDS:
            if kind not in reference.element_kinds or (kind != "bars" and dims != 3):
                continue
            table = where[reference.indices(kind)]
            whole = np.flatnonzero((table >= 0).all(axis=1))
            if len(whole):
                self._tables[kind] = (whole, table[whole])
                self._sums[kind] = np.zeros((3, len(whole)))

    def add(self, x: Reals, y: Reals) -> None:
        """Add instants: (B, n, d) each."""
        for kind, (_, table) in self._tables.items():
            apart = np.abs(_measure(kind, x, table) - _measure(kind, y, table))
            if kind == "hinges":
                # Angles of one fold may be a whole turn apart.
                apart = np.minimum(apart, 2.0 * np.pi - apart)
            sums = self._sums[kind]
            sums[0] += np.nansum(apart**2, axis=0)
            sums[1] += np.isfinite(apart).sum(axis=0)
            sums[2] = np.fmax(sums[2], np.fmax.reduce(apart, axis=0))

    def result(self) -> tuple[ElementError, ...]:
        """Return one record for each kind that was seen."""
        found = []
        for kind, (whole, _) in self._tables.items():
            squares, count, largest = self._sums[kind]
            if not count.sum():
                continue
            worst = int(np.argmax(largest))
            found.append(
                ElementError(
                    kind,
                    KINDS[kind],
                    self._unit if kind == "bars" else "rad",
                    float(np.sqrt(squares.sum() / count.sum())),
                    float(largest[worst]),
                    int(whole[worst]),
                    len(whole),
                )
            )
        return tuple(found)


def _measure(kind: str, places: Reals, table: NDArray[np.intp]) -> Reals:
    if kind == "bars":
        along = places[:, table[:, 1]] - places[:, table[:, 0]]
        return np.sqrt((along**2).sum(axis=2))
    return bend_angles(places, table) if kind == "bends" else dihedral_angles(places, table)


__all__ = ["ElementError", "ElementSums"]
