"""What drives the body, as states: for baselines, and for readouts that also see the input."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from openprc.reservoir.features.base import Feature
from openprc.reservoir.io.state_loader import StateLoader


class Inputs(Feature):
    """Values of the inputs at every frame; columns named such as ``"base.z"``.

    Parameters
    ----------
    input_names : int, str, or sequence of them, optional
        Inputs by position or by name; all by default.
    dof : int, str, or sequence of them, optional
        Columns of each, as for `StateLoader.get_actuation_signal`; all by default.
    """

    def __init__(
        self,
        input_names: int | str | Sequence[int | str] | None = None,
        *,
        dof: int | str | Sequence[int | str] | None = None,
    ) -> None:
        self.input_names = input_names
        self.dof = dof

    def _transform(self, loader: StateLoader) -> NDArray[np.float64]:
        return loader.input_values(self.input_names, dof=self.dof)

    def _names(self, loader: StateLoader) -> list[str]:
        return loader.input_columns(self.input_names, dof=self.dof)
