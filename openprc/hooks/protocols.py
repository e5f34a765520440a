"""What the code behind a record offers. Structural: no base class is needed."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from openprc.schema import Experiment, Finding, Trajectory, TrajectoryWriter

#: Called by runners as ``progress(fraction, message)`` with fraction in [0, 1].
Progress = Callable[[float, str], None]


@runtime_checkable
class Importer(Protocol):
    """Turns a foreign file into a trajectory (capability ``"import"``)."""

    def sniff(self, path: Path) -> float:
        """Say how sure this importer is that it can read `path` (a file or a folder).

        1.0 verified by content, 0.7 the structure fits, 0.3 only the name fits, 0.0 no.
        Never raises, never writes, returns within a second.
        """
        ...

    def import_run(
        self, path: Path, writer: TrajectoryWriter, *, options: Mapping[str, Any]
    ) -> None:
        """Write the run found at `path` into `writer`.

        `options` holds every option of the record, defaults filled in, and ``"trust"``
        (bool) when the record says ``trusts_pickle``. The host opens and closes the writer
        and hashes `path`; files read besides it are named with ``writer.add_source``.
        """
        ...


@runtime_checkable
class Runner(Protocol):
    """Simulates an experiment folder (capability ``"run"``)."""

    def supports(self, experiment: Experiment) -> Sequence[Finding]:
        """Return what this producer cannot model in `experiment`; empty means all of it."""
        ...

    def run(
        self,
        experiment: Experiment,
        writer: TrajectoryWriter,
        *,
        seed: int | None,
        progress: Progress,
    ) -> None:
        """Simulate `experiment` and append every saved frame, t = 0 first, to `writer`.

        A producer whose record has ``run_options`` is also given ``options``, a mapping that
        holds every one of them, defaults filled in.
        """
        ...


class RunPlan(Protocol):
    """What a producer knows about a run before it is made."""

    @property
    def findings(self) -> Sequence[Finding]:
        """What is refused ("error"), and what is odd ("warning", "hint")."""
        ...

    @property
    def remarks(self) -> Sequence[str]:
        """What the run would note in its file."""
        ...

    def rows(self) -> Sequence[tuple[str, str]]:
        """Return names and texts for a table."""
        ...

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, for JSON."""
        ...


@runtime_checkable
class Planner(Protocol):
    """A `Runner` that can say beforehand what a run would do; optional."""

    def plan(self, experiment: Experiment) -> RunPlan:
        """Look at `experiment` without running it."""
        ...


@runtime_checkable
class Settler(Protocol):
    """A `Runner` that chooses integrator and step for an accuracy; optional."""

    def settled(self, experiment: Experiment, *, verify: bool = False) -> Experiment:
        """Return the experiment with everything chosen and its accuracy gone; notes say why.

        With `verify` they also say how large the error of the run is, by an estimate of its own.
        """
        ...


@dataclass(frozen=True)
class Modelled:
    """How a producer's model of an experiment differs from what the experiment says.

    ``leaves_out`` is what the experiment has and the result will not show, ``adds`` what the
    result will show and the experiment does not have; a clause each, without a full stop.
    What is refused is neither: `Runner.supports` tells that.
    """

    leaves_out: tuple[str, ...] = ()
    adds: tuple[str, ...] = ()


@runtime_checkable
class Describer(Protocol):
    """A `Runner` that can say what its model leaves out and adds; optional.

    Examples
    --------
    >>> from openprc.hooks.protocols import Describer, Modelled
    >>> class Statics:
    ...     def models(self, experiment):
    ...         return Modelled(leaves_out=("inertia: masses play no part",))
    >>> isinstance(Statics(), Describer)
    True
    """

    def models(self, experiment: Experiment) -> Modelled:
        """Say so of `experiment`, with default options and without running it.

        Also of an experiment that is refused, where this tells what would be left out if the
        refused parts were not there.
        """
        ...


@runtime_checkable
class Recorder(Protocol):
    """Attaches to a simulation whose loop the user's own script owns (``"record"``)."""

    def attach(
        self, simulator: Any, writer: TrajectoryWriter, **options: Any
    ) -> AbstractContextManager[Any]:
        """Return a context manager that records while it is open.

        Entering it gives the script what it calls in its loop. The host opens the writer
        and closes it after the context manager (`openprc.hooks.recording.record_run`).
        """
        ...


@dataclass(frozen=True)
class Sample:
    """A small run in a producer's own format, and how to import it.

    ``inputs`` are symbol sequences that the foreign format has no room for; the demo
    attaches them after the import: name to ``{"sequence", "hold", "start", "unit",
    "quantity"}``.
    """

    path: Path
    options: Mapping[str, Any] = field(default_factory=dict)
    inputs: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


class SampleWriter(Protocol):
    """Writes a `Sample` into a folder that the caller made."""

    def __call__(self, folder: Path) -> Sample:
        """Write the files and say how to import them."""
        ...


class Feature(Protocol):
    """Trajectory to state matrix."""

    def transform(self, source: Any) -> NDArray[np.float64]:
        """Return the (T, F) state matrix of a trajectory or state loader."""
        ...

    def names(self, source: Any) -> list[str]:
        """Return the F column names."""
        ...


class Readout(Protocol):
    """A scikit-learn style regressor or classifier."""

    def fit(self, X: Any, y: Any) -> Any:
        """Learn from (T, F) states and (T,) or (T, O) targets; return self."""
        ...

    def predict(self, X: Any) -> Any:
        """Return the prediction for (T, F) states."""
        ...


class Task(Protocol):
    """A factory of tasks, or a plain function of the input sequence.

    ``load(**parameters)`` returns an `openprc.analysis.tasks.task.Task`. A function of one
    argument ``u`` that returns the (K,) or (K, O) target of the (K,) input is taken as one.
    """

    def __call__(self, *u: NDArray[np.float64], **parameters: Any) -> Any:
        """Return the task, or the target of `u`."""
        ...


class Benchmark(Protocol):
    """States and input to named numbers."""

    def run(self, trainer: Any, u: NDArray[np.float64], **parameters: Any) -> Any:
        """Return a score with ``metrics`` and ``metadata``."""
        ...


class Detector(Protocol):
    """Image to points."""

    def detect(self, image: Any) -> NDArray[np.float64]:
        """Return (N, 2) points in px, (0, 0) at the centre of the upper left pixel."""
        ...


class Exporter(Protocol):
    """Trajectory to another format."""

    def export(
        self, trajectory: Trajectory, path: Path, *, options: Mapping[str, Any]
    ) -> Iterable[Path]:
        """Write `trajectory` to `path` and return the files made, all of them beside it.

        `options` holds every option of the record, defaults filled in, and ``"final"``, the
        path that the file gets once all of them are written: what is written refers to other
        files as seen from there.
        """
        ...
