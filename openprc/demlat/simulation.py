"""`Simulation`: an experiment folder, and where its result goes."""

from __future__ import annotations

from functools import cached_property
from pathlib import Path

from openprc.schema.experiment import Experiment, load_experiment
from openprc.schema.experiment_files import input_folder

RESULT = Path("output") / "simulation.h5"


class Simulation:
    """An experiment folder, read on first use.

    Parameters
    ----------
    directory : path-like
        The folder that has ``input/``, or that ``input`` folder itself.

    Raises
    ------
    UnreadableFile
        When there is no experiment.
    """

    def __init__(self, directory: str | Path) -> None:
        folder = input_folder(directory)
        self.directory = folder.parent if folder.name == "input" else folder

    @cached_property
    def experiment(self) -> Experiment:
        """What the input files say."""
        return load_experiment(self.directory)

    @property
    def result_path(self) -> Path:
        """Where the engine writes: ``output/simulation.h5``."""
        return self.directory / RESULT

    def __repr__(self) -> str:
        return f"Simulation({str(self.directory)!r})"
