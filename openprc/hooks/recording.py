"""From a loop that a user's own script runs to a validated simulation.h5."""

from __future__ import annotations

import atexit
import inspect
import sys
import time
from pathlib import Path
from types import TracebackType
from typing import Any

from openprc.errors import ConfigError
from openprc.hooks.faults import owned_by
from openprc.hooks.importing import ProducedRun, describe_run, provenance_of, refuse_invalid
from openprc.hooks.registry import Registered, Registry, default_registry
from openprc.schema.findings import Finding
from openprc.schema.writer import TrajectoryWriter


class Recording:
    """A recording under way; made by `record_run`.

    As a context manager it gives the script the recorder's own `session` and closes at the
    end of the block. Without one, `close` ends it; a script that forgets to is caught when
    the interpreter exits, and an error that ended the script leaves the status "failed".
    """

    def __init__(self, item: Registered, writer: TrajectoryWriter, *, registry: Registry) -> None:
        self._item = item
        self._registry = registry
        self._started = time.perf_counter()
        self._findings: list[Finding] = []
        self._attached: Any = None
        self._open = True
        self.writer = writer
        #: What the recorder gave the script to call; see the documentation of the plugin.
        self.session: Any = None

    def attach(self, recorder: Any, simulator: Any, options: dict[str, Any]) -> None:
        """Let a recorder attach to the simulator; `record_run` does."""
        try:
            with owned_by(self._item.qualified_name, "attaching to the simulator"):
                self._attached = recorder.attach(simulator, self.writer, **options)
                self.session = self._attached.__enter__()
        except BaseException:
            self._open = False
            self.writer.__exit__(*sys.exc_info())
            raise
        atexit.register(self._at_exit)

    @property
    def path(self) -> Path:
        """Where the finished file will be."""
        return self.writer.path

    def close(self) -> ProducedRun | None:
        """Finish the file and return its outline; None when it was closed before.

        Raises
        ------
        SchemaError
            When nothing was recorded, or the result would not be valid.
        PluginError
            When the recorder fails.
        """
        if not self._open:
            return None
        self._end(None, None, None)
        return describe_run(
            self.path, self._item, confidence=1.0, notes=self.writer.notes,
            findings=self._findings, seconds=time.perf_counter() - self._started,
        )  # fmt: skip

    def __enter__(self) -> Any:
        return self.session

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        if self._open:
            self._end(kind, error, trace)

    def _end(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._open = False
        atexit.unregister(self._at_exit)
        with self.writer:
            # What the recorder may do with an error is look at it; it cannot swallow it.
            with owned_by(self._item.qualified_name, "ending the recording"):
                self._attached.__exit__(kind, error, trace)
            if error is not None:
                raise error
            self.writer.commit()

    def check(self, partial: Path) -> None:
        """Validate the finished file before it gets its final name; the writer calls it."""
        self._findings.extend(refuse_invalid(partial, self.path, self._registry))

    def _at_exit(self) -> None:
        """Close what a script left open; one that died of an error left half a run."""
        error = getattr(sys, "last_value", None)
        if error is None:
            self._end(None, None, None)
        else:
            self._end_failed(error)

    def _end_failed(self, error: BaseException) -> None:
        try:
            self._end(type(error), error, error.__traceback__)
        except BaseException as raised:
            if raised is not error:
                raise


def record_run(
    simulator: Any,
    out: str | Path,
    *,
    producer: str,
    seed: int | None = None,
    overwrite: bool = False,
    registry: Registry | None = None,
    **options: Any,
) -> Recording:
    """Attach a recorder to a simulator whose loop the calling script owns.

    Parameters
    ----------
    simulator : object
        What the producer's recorder attaches to: a client, a simulator, a world.
    out : path-like
        The simulation.h5 to write.
    producer : str
        Whose recorder.
    seed : int, optional
        The seed of the script, for the record of how the file came about.
    overwrite : bool
        Replace a finished file of this name, once the new one is complete.
    **options
        What that recorder takes.

    Returns
    -------
    Recording

    Raises
    ------
    UnknownName, MissingDependency
        When there is no such recorder, or its simulator is not installed.
    ConfigError
        When the recorder has no such option.
    ResultExists
        When `out` is there and `overwrite` is false.
    PluginError
        When the recorder cannot attach.
    """
    registry = registry or default_registry()
    item = registry.producer(producer)
    recorder = registry.load(item, capability="record")
    _check_options(recorder, options)
    provenance = provenance_of(item, seed=seed)
    checks: list[Recording] = []
    writer = TrajectoryWriter(
        Path(out),
        provenance=provenance,
        overwrite=overwrite,
        verify=lambda partial: checks[0].check(partial),
    )
    recording = Recording(item, writer, registry=registry)
    checks.append(recording)
    recording.attach(recorder, simulator, options)
    return recording


def _check_options(recorder: Any, options: dict[str, Any]) -> None:
    """Refuse a misspelt option: it is the script's fault, not the plugin's."""
    parameters = inspect.signature(recorder.attach).parameters.values()
    if any(parameter.kind is parameter.VAR_KEYWORD for parameter in parameters):
        return
    known = [p.name for p in parameters if p.kind is p.KEYWORD_ONLY]
    for name in options:
        if name not in known:
            raise ConfigError(
                f"there is no option {name!r}",
                expected="some of " + (", ".join(known) or "none: the recorder takes no options"),
                fix="correct the call of record_run",
                key=name,
            )


__all__ = ["Recording", "record_run"]
