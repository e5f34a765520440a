"""`Engine`: run an experiment folder and leave its ``output/simulation.h5``."""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from openprc import __version__
from openprc.demlat.backends.choose import choose_backend
from openprc.demlat.models.barhinge.model import BACKENDS, Backend, BarHingeModel
from openprc.demlat.producer import DemlatProducer
from openprc.demlat.simulation import Simulation
from openprc.errors import ConfigError, OpenPRCError
from openprc.hooks.running import settings_of, silent, simulate, with_requests
from openprc.schema.provenance import Provenance, typed_command

if TYPE_CHECKING:
    from openprc.hooks.protocols import Progress
    from openprc.schema.experiment import Experiment


@dataclass(frozen=True)
class RunResult:
    """Where the trajectory is, how many frames it has, and what should be known about it.

    ``wall_time`` [s] includes compiling, the first time on a machine.
    """

    path: Path
    n_frames: int
    wall_time: float
    notes: tuple[str, ...] = ()


class Engine:
    """Runs simulations with one model.

    Parameters
    ----------
    model : type
        `BarHingeModel`.
    backend : {"auto", "cpu", "cuda", "jax"}
        See `BarHingeModel`.

    Examples
    --------
    >>> from openprc import demlat
    >>> from openprc.demlat import BarHingeModel
    >>> engine = demlat.Engine(BarHingeModel, backend="auto")
    """

    def __init__(self, model: type[BarHingeModel], backend: Backend = "auto") -> None:
        if not (isinstance(model, type) and issubclass(model, BarHingeModel)):
            raise ConfigError(
                f"the model {model!r}",
                expected="the class openprc.demlat.BarHingeModel, not an object of it",
                key="model",
            )
        if backend not in BACKENDS:
            raise ConfigError(
                f"the backend {backend!r}", expected="one of " + ", ".join(BACKENDS), key="backend"
            )
        self.model = model
        self.backend: Backend = backend

    def run(
        self,
        simulation: Simulation | str | Path,
        *,
        integrator: str | None = None,
        accuracy: float | None = None,
        verify: bool = False,
        overwrite: bool | None = None,
        progress: Progress | None = None,
    ) -> RunResult:
        """Simulate, and write ``output/simulation.h5``.

        Parameters
        ----------
        simulation : Simulation or path-like
        integrator : str, optional
            Instead of the one in config.json, in which older folders name none; "legacy"
            repeats the stepping of openprc up to 0.1.1.
        accuracy : float in (0, 1), optional
            Choose the step for this error, and the integrator unless `integrator` names one;
            see `openprc.demlat.planning.accuracy`.
        verify : bool
            Estimate the error of the run, and note it.
        overwrite : bool, optional
            Replace a finished result. By default as ``export.overwrite`` in config.json says,
            which a `SimulationSetup` made with ``overwrite=True`` sets.
        progress : callable, optional
            Called as ``progress(fraction, message)``.

        Raises
        ------
        ResultExists
            When there is a result that may not be replaced.
        UnsupportedScene
            When the scene has something that the engine cannot model.
        Diverged
            When the integration blows up; the frames before that stay in
            ``simulation.h5.partial``.
        """
        began = time.perf_counter()
        if not isinstance(simulation, Simulation):
            simulation = Simulation(simulation)
        asked = with_requests(simulation.experiment, integrator=integrator, accuracy=accuracy)
        producer = DemlatProducer(model=self.model, backend=self.backend)
        experiment = producer.settled(asked, verify=verify)
        provenance = Provenance(
            "demlat",
            producer_version=__version__,
            plugin_version=__version__,
            command=typed_command(),
            deterministic=_repeats_bits(experiment, self.backend),
            config=settings_of(experiment, asked),
        )
        notes, _ = simulate(
            experiment,
            producer,
            target=simulation.result_path,
            provenance=provenance,
            owner="openprc/demlat",
            overwrite=experiment.overwrite if overwrite is None else overwrite,
            progress=progress or silent,
        )
        return RunResult(
            path=simulation.result_path,
            n_frames=experiment.n_frames,
            wall_time=time.perf_counter() - began,
            notes=notes,
        )


def _repeats_bits(experiment: Experiment, backend: Backend) -> bool:
    """Say whether a run gives the same bits again: JAX may sum in any order on a device."""
    try:
        return choose_backend(experiment, backend).name != "jax"
    except OpenPRCError:
        return True  # there will be no run
