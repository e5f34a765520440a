"""An open trajectory file: its clock, its sizes, and what becomes of missing samples."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Literal, Self

import numpy as np
from numpy.typing import NDArray

from openprc.errors import TaskError
from openprc.reservoir.io.missing import POLICIES, MissingPolicy, apply_policy
from openprc.schema import UNITS, Trajectory

Origin = Literal["auto", "rest", "first"]


class Recording:
    """What the states of nodes, bars, hinges and channels are read from.

    Parameters
    ----------
    path : path-like or Trajectory
    missing : {"error", "drop", "interpolate"}
    """

    def __init__(self, path: str | Path | Trajectory, *, missing: MissingPolicy = "error") -> None:
        if missing not in POLICIES:
            raise TaskError(
                f"missing is {missing!r}",
                expected="one of " + ", ".join(POLICIES),
                fix="choose one of these",
                key="missing",
            )
        self.trajectory = path if isinstance(path, Trajectory) else Trajectory(path)
        self.missing = missing
        self.path = Path(self.trajectory.path)

    def close(self) -> None:
        """Close the file."""
        self.trajectory.close()

    def __enter__(self) -> Self:
        """Return the loader itself."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Close the file."""
        self.close()

    # --- clock and sizes -------------------------------------------------------------------

    @property
    def n_frames(self) -> int:
        """Number of saved frames, T."""
        return self.trajectory.n_frames

    @property
    def n_nodes(self) -> int:
        """Number of nodes, N; 0 in a file without positions."""
        return self.trajectory.n_nodes

    @property
    def dims(self) -> int:
        """Number of measured coordinates, D."""
        return self.trajectory.dims

    @property
    def run_id(self) -> str:
        """Identifier of the run that the file holds."""
        return self.trajectory.run_id

    @property
    def time_kind(self) -> str:
        """``"physical"``, or ``"pseudo"`` for quasi-static load steps."""
        return self.trajectory.time_kind

    @property
    def time(self) -> NDArray[np.float64]:
        """Frame times, (T,) [s]."""
        return self.trajectory.time * self._seconds

    @property
    def dt(self) -> float:
        """Time between frames [s].

        Raises
        ------
        NonUniformTime
            When the frames are not evenly spaced.
        """
        return float(self.trajectory.dt) * self._seconds

    @property
    def _seconds(self) -> float:
        if self.time_kind != "physical":
            return 1.0
        return UNITS[self.trajectory.time_unit].si_factor

    def require_physical_time(self, purpose: str) -> None:
        """Refuse a file whose time counts load steps.

        Raises
        ------
        TaskError
            When time is pseudo: there are no dynamics, so there is no memory to measure.
        """
        if self.time_kind == "physical":
            return
        raise TaskError(
            f"time is {self.time_kind}: the frames are load steps of a quasi-static analysis",
            expected=f"physical time, because {purpose} depends on how the body remembers",
            fix="use the file for static comparisons, or simulate the body dynamically",
            file=self.path,
            key="/time_series/time",
        )

    # --- for the classes that read states ----------------------------------------------------

    def treated(
        self, values: NDArray[np.float64], labels: list[str], key: str
    ) -> NDArray[np.float64]:
        """Return values (T, N, ...) with missing samples treated as `missing` says."""
        return apply_policy(
            values,
            self.missing,
            time=self.time,
            labels=labels,
            file=str(self.path),
            key=f"/time_series/{key}",
        )

    def check_ids(
        self, ids: Sequence[int] | None, count: int, *, what: str, key: str | None = None
    ) -> list[int]:
        """Return `ids` as a list of plain integers, or all of them for ``None``.

        Raises
        ------
        TaskError
            When one is not a whole number in [0, count), or is named twice.
        """
        if ids is None:
            return list(range(count))
        key = key or f"{what}_ids"
        chosen = list(np.atleast_1d(np.asarray(ids)).tolist())
        wrong = [
            i for i in chosen if isinstance(i, bool) or not isinstance(i, int) or not 0 <= i < count
        ]
        if wrong or len(set(chosen)) != len(chosen) or not chosen:
            reason = f"of which {wrong} do not exist" if wrong else "empty or with repetitions"
            raise TaskError(
                f"{key} is {chosen}, {reason}",
                expected=f"different {what} numbers from 0 to {count - 1}",
                fix=f"correct {key}",
                file=self.path,
                key=key,
            )
        return chosen

    def check_origin(self, origin: str) -> None:
        """Refuse an origin that is not one of the three."""
        if origin not in ("auto", "rest", "first"):
            raise TaskError(
                f"origin is {origin!r}",
                expected="auto, rest or first",
                fix="choose one of these",
                key="origin",
            )
