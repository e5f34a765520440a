"""What plugins keep of their own below ``/extensions``."""

from __future__ import annotations

from typing import Any

from numpy.typing import NDArray

from openprc.schema.damage import damage_named
from openprc.schema.layout import TIME_AXIS
from openprc.schema.stored import ALL, Frames, StoredData


class Extensions(StoredData):
    """The part of `Trajectory` that reads the subtrees of plugins."""

    @property
    def extensions(self) -> tuple[str, ...]:
        """Distributions that have a subtree of their own."""
        return self._names("extensions")

    def extension_names(self, distribution: str) -> tuple[str, ...]:
        """Return the names of what a distribution's own subtree holds."""
        return self._names(f"extensions/{distribution}")

    def extension_series(self, distribution: str) -> tuple[str, ...]:
        """Return those of `extension_names` that have one row a frame."""
        base = f"extensions/{distribution}"
        with damage_named(self.path, base):
            return tuple(
                name
                for name in self._names(base)
                if TIME_AXIS in self._file[f"{base}/{name}"].attrs
            )

    def extension(
        self, distribution: str, name: str, *, frames: Frames | None = None
    ) -> NDArray[Any]:
        """Return an array of a distribution's own subtree, as stored.

        Of a time series, the committed frames or those of `frames`, (T', ...).

        Raises
        ------
        MissingData
            When it is not in the file.
        SchemaError
            When `frames` are asked for and it has not one row a frame.
        """
        path = f"/extensions/{distribution}/{name}"
        if frames is None and TIME_AXIS not in self._get(path).attrs:
            return self._static(path, None)
        return self._series(path, ALL if frames is None else frames)
