"""Angles of hinges, and whatever else a producer records of its elements."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from openprc.reservoir.features.base import Feature
from openprc.reservoir.io.state_loader import StateLoader


class HingeAngles(Feature):
    """Dihedral angles of hinges, stored or from the positions.

    Parameters
    ----------
    hinge_ids : sequence of int, optional
        Which hinges, from 0; all by default.
    """

    def __init__(self, hinge_ids: Sequence[int] | None = None) -> None:
        self.hinge_ids = hinge_ids

    def _transform(self, loader: StateLoader) -> NDArray[np.float64]:
        return loader.hinge_angles(self.hinge_ids)

    def _names(self, loader: StateLoader) -> list[str]:
        hinges = loader.check_ids(self.hinge_ids, loader.n_hinges, what="hinge")
        return [f"hinge{i}" for i in hinges]


class ElementSeries(Feature):
    """A recorded quantity of elements, such as the forces of bars or the torques of hinges.

    Parameters
    ----------
    kind, quantity : str
        As in the file: ``ElementSeries("bars", "force")``.
    element_ids : sequence of int, optional
        Which elements, from 0; all by default.
    """

    def __init__(
        self, kind: str, quantity: str, *, element_ids: Sequence[int] | None = None
    ) -> None:
        self.kind = kind
        self.quantity = quantity
        self.element_ids = element_ids

    def _transform(self, loader: StateLoader) -> NDArray[np.float64]:
        values = loader.element_series(self.kind, self.quantity, self.element_ids)
        return values.reshape(len(values), -1)

    def _names(self, loader: StateLoader) -> list[str]:
        kind = self.kind[:-1] if self.kind.endswith("s") else self.kind
        count = loader.n_elements(self.kind)
        chosen = loader.check_ids(self.element_ids, count, what=kind)
        shape = loader.element_series(self.kind, self.quantity, chosen[:1]).shape[2:]
        parts = [f".{part}" for part in range(shape[0])] if shape else [""]
        return [f"{kind}{i}.{self.quantity}{part}" for i in chosen for part in parts]
