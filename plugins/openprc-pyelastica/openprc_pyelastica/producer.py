"""The producer: importer, recorder and runner behind one name, each loaded when it is used."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from openprc.errors import ConfigError
from openprc_pyelastica.importer import Importer

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from openprc.hooks.protocols import Modelled, Progress
    from openprc.schema import Experiment, Finding, TrajectoryWriter
    from openprc_pyelastica.recorder import Session


class Producer(Importer):
    """What the record of this plugin loads; see the modules of its parts."""

    def attach(
        self, simulator: Any, writer: TrajectoryWriter, **options: Any
    ) -> AbstractContextManager[Session]:
        """Record a simulator of a user's script; see `openprc_pyelastica.recorder.attach`.

        Raises
        ------
        ConfigError
            When there is no such option, or nothing can be recorded.
        """
        from openprc_pyelastica.recorder import OPTIONS, attach  # noqa: PLC0415

        unknown = sorted(set(options) - set(OPTIONS))
        if unknown:
            raise ConfigError(
                f"there is no option {unknown[0]!r}",
                expected="some of " + ", ".join(OPTIONS),
                fix="correct the call of record_run",
                key=unknown[0],
            )
        return attach(simulator, writer, **options)

    def supports(self, experiment: Experiment) -> Sequence[Finding]:
        """Return what a rod cannot model in `experiment`; empty means all of it."""
        from openprc_pyelastica.runner_scope import findings  # noqa: PLC0415

        return list(findings(experiment))

    def models(self, experiment: Experiment) -> Modelled:
        """Return what a rod has and a chain of bars has not."""
        from openprc_pyelastica.model_differences import modelled  # noqa: PLC0415

        return modelled(experiment)

    def run(
        self,
        experiment: Experiment,
        writer: TrajectoryWriter,
        *,
        seed: int | None,
        progress: Progress,
        options: Mapping[str, Any] | None = None,
    ) -> None:
        """Simulate `experiment` with rods; see `openprc_pyelastica.runner.run`."""
        from openprc_pyelastica.runner import run  # noqa: PLC0415

        del seed  # no random numbers are drawn
        run(experiment, writer, progress=progress, options=options or {})
