"""The classes that a simulator calls: made when there is one, since they derive from its own."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.metadata import PackageNotFoundError, version
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from openprc_pyelastica.recorder import Session


#: Registers dampers and never calls them; no other version is known to.
UNDAMPED = "0.3.3"


def version_notes(simulator: Any) -> Iterator[str]:
    """Yield which PyElastica runs, and what a reader of its results should know about it."""
    try:
        installed = version("pyelastica")
    except PackageNotFoundError:
        return
    yield f"recorded from PyElastica {installed}"
    if installed == UNDAMPED and getattr(simulator, "_damping_list", None):
        yield (
            f"PyElastica {UNDAMPED} registers dampers and never calls them: nothing was damped in "
            "this run (1.0 does call them)"
        )


def callback_class() -> type:
    """Return the callback class of the installed PyElastica.

    It is made with ``session`` and ``every``; the simulator may call it with one system or with
    a tuple, list or dict of them.
    """
    from elastica.callback_functions import CallBackBaseClass

    class RecordingCallBack(CallBackBaseClass):  # type: ignore[misc]
        """Hands every `every`-th state to a session."""

        def __init__(self, session: Session, every: int) -> None:
            super().__init__()
            self._session = session
            self._take = session.take
            self._every = every
            self._left = 1  # the first call, at t = 0, counts

        def make_callback(self, system: Any, time: float, current_step: int) -> None:
            """Record the state, when its turn has come."""
            # Counted here: current_step is time / dt rounded, and dt may change.
            left = self._left - 1
            if left:
                self._left = left
                return
            self._left = self._every
            self._take(system, time)

        def on_close(self) -> None:
            """Make what was recorded so far safe; the simulator's close() calls it."""
            self._session.flush(commit=True)

    return RecordingCallBack


def watched(forcing: type, watch: ForceWatch) -> type:
    """Return a subclass of a forcing class that reports the net force of each step.

    Parameters
    ----------
    forcing : type
        A subclass of PyElastica's ``NoForces``.
    watch : ForceWatch
        Where the force is put.
    """

    class Watched(forcing):  # type: ignore[misc, valid-type]
        def apply_forces(self, system: Any, time: float = 0.0) -> None:
            before = system.external_forces.sum(axis=1)
            super().apply_forces(system, time)
            watch.report(system.external_forces.sum(axis=1) - before)

    Watched.__name__ = Watched.__qualname__ = f"Watched{forcing.__name__}"
    return Watched


class ForceWatch:
    """The net force that a forcing applied in the latest step: (3,) [N].

    Before the first step nothing has been applied. The frame at t = 0 is given the force of the
    first step, which acts from t = 0 on.
    """

    def __init__(self) -> None:
        self.force = np.zeros(3)
        self.first: np.ndarray[Any, np.dtype[np.float64]] | None = None

    def report(self, force: np.ndarray[Any, np.dtype[np.float64]]) -> None:
        """Take the force of a step."""
        self.force = force
        if self.first is None:
            self.first = force

    def read(self, time: float, step: int) -> np.ndarray[Any, np.dtype[np.float64]]:
        """Return the force for a frame, as a signal does."""
        del time, step
        return self.force
