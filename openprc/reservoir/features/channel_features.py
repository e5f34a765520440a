"""Sensor channels as reservoir states: joint angles, forces, voltages."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from openprc.errors import MissingData
from openprc.reservoir.features.base import Feature
from openprc.reservoir.io.state_loader import StateLoader


class Channels(Feature):
    """All columns of one or more channels, in the order given.

    Parameters
    ----------
    channel_names : str or sequence of str, optional
        Which channels; all by default, in the order of the file.
    """

    def __init__(self, channel_names: str | Sequence[str] | None = None) -> None:
        self.channel_names = channel_names

    def _chosen(self, loader: StateLoader) -> list[str]:
        names = self.channel_names
        if isinstance(names, str):
            names = [names]
        chosen = list(loader.channels) if names is None else list(names)
        unknown = [name for name in chosen if name not in loader.channels]
        if unknown or not chosen:
            raise MissingData(
                f"no channel {', '.join(map(repr, unknown))}" if unknown else "no channels",
                expected="one of " + (", ".join(loader.channels) or "nothing: there are none"),
                fix="name channels that are in the file, or use node or bar features",
                file=loader.path,
                key="/time_series/channels",
            )
        return chosen

    def _transform(self, loader: StateLoader) -> NDArray[np.float64]:
        return np.hstack([loader.channel(name) for name in self._chosen(loader)])

    def _names(self, loader: StateLoader) -> list[str]:
        return [
            f"{name}.{column}"
            for name in self._chosen(loader)
            for column in loader.trajectory.channel_columns(name)
        ]
