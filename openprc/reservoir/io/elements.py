"""States of elements between nodes: bars, hinges, and whatever else a producer records."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from openprc.errors import MissingData, TaskError
from openprc.reservoir.io.nodes import NodeMotion
from openprc.reservoir.io.recording import Origin
from openprc.schema.dihedral import dihedral_angles

_SPACE = 3


class ElementStates(NodeMotion):
    """The part of `StateLoader` that reads bars, hinges and recorded element series."""

    # --- any kind ------------------------------------------------------------------------------

    def n_elements(self, kind: str) -> int:
        """Return the number of elements of a kind, such as ``"bars"``.

        Raises
        ------
        MissingData
            When the file has none of that kind.
        """
        kinds = self.trajectory.element_kinds
        if kind not in kinds:
            raise MissingData(
                f"the file has no {kind}",
                expected=f"/topology/{kind}/indices; there are " + (", ".join(kinds) or "none"),
                fix="use node or channel features",
                file=self.path,
                key=f"/topology/{kind}",
            )
        return len(self.trajectory.indices(kind))

    def element_series(
        self, kind: str, quantity: str, elements: Sequence[int] | None = None
    ) -> NDArray[np.float64]:
        """Return a recorded quantity of elements, (T, n) or (T, n, k) in the unit of the file.

        Parameters
        ----------
        kind, quantity : str
            Such as ``"bars"`` and ``"force"``.
        elements : sequence of int, optional
            Which ones, from 0; all by default.

        Raises
        ------
        MissingData
            When the file has no such elements, or did not record that quantity of them.
        """
        chosen = self.check_ids(elements, self.n_elements(kind), what=_singular(kind))
        recorded = self.trajectory.element_series(kind)
        if quantity not in recorded:
            raise MissingData(
                f"{quantity} of the {kind} was not recorded",
                expected="one of " + (", ".join(recorded) or "nothing: no series is stored"),
                fix="record it with the producer, or choose another quantity",
                file=self.path,
                key=f"/time_series/elements/{kind}/{quantity}",
            )
        values = np.asarray(self.trajectory.element(kind, quantity), dtype=np.float64)
        labels = [f"{_singular(kind)} {i}" for i in chosen]
        return self.treated(values[:, chosen], labels, f"elements/{kind}/{quantity}")

    # --- bars ----------------------------------------------------------------------------------

    @property
    def n_bars(self) -> int:
        """Number of bars; raises as `n_elements`."""
        return self.n_elements("bars")

    def bar_lengths(self, bars: Sequence[int] | None = None) -> NDArray[np.float64]:
        """Return bar lengths, (T, n) in the unit of the file.

        The stored series is used where there is one; otherwise the distance between the end
        nodes, which is the same number.

        Raises
        ------
        MissingData
            When the file has no bars.
        """
        chosen = self.check_ids(bars, self.n_bars, what="bar")
        if "length" in self.trajectory.element_series("bars"):
            return self.element_series("bars", "length", chosen)
        ends = np.asarray(self.trajectory.indices("bars"))[chosen]
        nodes, column = np.unique(ends, return_inverse=True)
        positions = self.positions(nodes.tolist())
        a, b = column.reshape(ends.shape).T
        return np.linalg.norm(positions[:, b] - positions[:, a], axis=2)

    def bar_extensions(
        self, bars: Sequence[int] | None = None, *, origin: Origin = "auto"
    ) -> NDArray[np.float64]:
        """Return bar lengths less the rest lengths, (T, n) in the unit of the lengths.

        With ``rest``, and with ``auto`` where the file stores rest lengths, these are
        subtracted; otherwise the lengths of the first frame. Where lengths are stored in
        float32, stored strains times rest lengths say the same with all their digits: rounding
        is then a fraction of the extension and not of the length.

        Raises
        ------
        MissingData
            As `bar_lengths`; with ``rest`` when the file stores no rest lengths; with
            ``first`` when a bar was not measured in the first frame.
        """
        lengths, rest = self._lengths_and_rest(bars, origin)
        extensions = lengths - rest
        if self.resolve_bar_origin(origin) == "rest":
            return self._with_digits_of_strains(bars, extensions, lengths=lengths, rest=rest)
        return extensions

    def _with_digits_of_strains(
        self,
        bars: Sequence[int] | None,
        extensions: NDArray[np.float64],
        *,
        lengths: NDArray[np.float64],
        rest: NDArray[np.float64],
    ) -> NDArray[np.float64]:
        """Return extensions from stored strains, where lengths were rounded and they agree."""
        stored = self.trajectory.element_series("bars")
        if not {"length", "strain"} <= set(stored) or not (rest > 0).all():
            return extensions
        if not in_single_precision(lengths):
            return extensions
        finer = self.element_series("bars", "strain", bars) * rest
        # Another definition of strain would differ by more than the lengths are rounded by.
        slack = 2.0 * np.spacing(np.abs(lengths).astype(np.float32))
        agree = (np.abs(finer - extensions) <= slack) | np.isnan(extensions)
        return finer if agree.all() else extensions

    def bar_strains(
        self, bars: Sequence[int] | None = None, *, origin: Origin = "auto"
    ) -> NDArray[np.float64]:
        """Return engineering strains ``(l - l_rest) / l_rest``, (T, n) [1].

        With ``auto`` a stored series is used where there is one.

        Parameters
        ----------
        origin : {"auto", "rest", "first"}
            As for `bar_extensions`.

        Raises
        ------
        MissingData
            As `bar_extensions`.
        TaskError
            When a rest length is not positive.
        """
        self.check_origin(origin)
        self.n_elements("bars")
        if origin == "auto" and "strain" in self.trajectory.element_series("bars"):
            return self.element_series("bars", "strain", bars)
        lengths, rest = self._lengths_and_rest(bars, origin)
        if not (rest > 0).all():
            chosen = self.check_ids(bars, self.n_bars, what="bar")
            raise TaskError(
                f"bar {chosen[int(np.argmin(rest))]} has the rest length {rest.min():g}",
                expected="positive rest lengths, by which extensions are divided",
                fix="leave that bar out with bar_ids, or use BarExtensions",
                file=self.path,
                key="/topology/bars/rest_length",
            )
        return lengths / rest - 1.0

    def resolve_bar_origin(self, origin: Origin) -> Literal["rest", "first"]:
        """Return what ``origin="auto"`` stands for in this file's bars."""
        self.check_origin(origin)
        if origin == "auto":
            return "rest" if self.trajectory.has("/topology/bars/rest_length") else "first"
        return origin

    def _lengths_and_rest(
        self, bars: Sequence[int] | None, origin: Origin
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        chosen = self.check_ids(bars, self.n_bars, what="bar")
        lengths = self.bar_lengths(chosen)
        if self.resolve_bar_origin(origin) == "rest":
            stored = "length" in self.trajectory.element_series("bars")
            series = "elements/bars/length" if stored else "nodes/positions"
            unit = self.trajectory.unit(f"/time_series/{series}")
            rest = self.trajectory.element_static("bars", "rest_length", unit=unit)
            return lengths, np.asarray(rest, dtype=np.float64)[chosen]
        if np.isnan(lengths[0]).any():
            raise MissingData(
                "the first frame has bars that were not measured, so extensions have no origin",
                expected="rest lengths, or a complete first frame",
                fix="leave those bars out with bar_ids, or use BarLengths",
                file=self.path,
                key="/time_series/elements/bars/length",
            )
        return lengths, lengths[0]

    # --- hinges --------------------------------------------------------------------------------

    @property
    def n_hinges(self) -> int:
        """Number of hinges; raises as `n_elements`."""
        return self.n_elements("hinges")

    def hinge_angles(self, hinges: Sequence[int] | None = None) -> NDArray[np.float64]:
        """Return dihedral angles, (T, n).

        The stored series is used where there is one, in the unit of the file; otherwise the
        angle between the panels in [0, 2 pi) [rad], pi being flat.

        Raises
        ------
        MissingData
            When the file has no hinges, or stores no angles and only planar positions.
        """
        chosen = self.check_ids(hinges, self.n_hinges, what="hinge")
        if "angle" in self.trajectory.element_series("hinges"):
            return self.element_series("hinges", "angle", chosen)
        if self.dims != _SPACE:
            raise MissingData(
                f"no hinge angle is stored and positions have {self.dims} coordinates",
                expected="stored angles, or positions in space",
                fix="record the angles with the producer",
                file=self.path,
                key="/time_series/elements/hinges/angle",
            )
        corners = np.asarray(self.trajectory.indices("hinges"))[chosen]
        nodes, column = np.unique(corners, return_inverse=True)
        positions = self.positions(nodes.tolist())
        return dihedral_angles(positions, column.reshape(corners.shape))


def in_single_precision(values: NDArray[np.float64]) -> bool:
    """Say whether values were stored in float32: all of them are numbers of that format."""
    return bool(np.array_equal(values, values.astype(np.float32), equal_nan=True))


def _singular(kind: str) -> str:
    return kind[:-1] if kind.endswith("s") else kind
