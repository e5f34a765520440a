"""The kit on what the package itself brings."""

import numpy as np
from older_files import motion, write_run

from openprc.schema.experiment import Experiment
from openprc.testing import ExporterCase, ImporterCase, RunnerCase, parametrize_with_checks
from openprc.vision import samples as video


def older_run(folder):
    return write_run(folder / "run.h5", motion())


def older_truth():
    return {
        "positions": motion().astype("f8"),
        "unit": "m",
        "time": (np.arange(len(motion())) * 0.05).astype("f4").astype("f8"),
        "tolerance": 1e-6,
    }


def video_truth():
    """Tracked points: the motion of the patches within a twentieth of a pixel."""
    return {"time": np.arange(video.N_SYMBOLS + 1) / video.FPS, "tolerance": 1e-6}


CASES = [
    ImporterCase("legacy", make_sample=older_run, truth=older_truth),
    # Tracking 500 frames again and again takes its time.
    ImporterCase("vision", truth=video_truth, slow=("ROBUST", "REPEAT", "LIGHT-3", "SPEC-3")),
    # What compiles kernels for every small scene takes a minute.
    RunnerCase("demlat", slow=("RUN-1", "RUN-7", "PHYS-5", "PHYS-8")),
    RunnerCase("demlat", integrator="verlet", slow=("RUN", "PHYS", "PIPE", "LIGHT")),
    ExporterCase("csv", importer="openprc-example/csv"),
    ExporterCase("npz"),
]


@parametrize_with_checks(CASES)
def test_conforms(case, check, tmp_path):
    check(case, tmp_path)


def test_the_scenes_of_the_kit_are_experiments():
    from openprc.testing.simulations import driven_lattice, driven_oscillator

    for scene in (driven_lattice(), driven_oscillator(), driven_oscillator(kind="position")):
        assert isinstance(scene, Experiment)
