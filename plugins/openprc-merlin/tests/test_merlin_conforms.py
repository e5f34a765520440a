"""The kit on importers, exporters and the runner of MERLIN and FOLD files."""

import numpy as np
from openprc_merlin import openprc_exporters, openprc_producers, samples

from openprc.testing import ExporterCase, ImporterCase, RunnerCase, parametrize_with_checks


def truth():
    """The free wing turns about the crease on a circle of 1 mm; bars keep their lengths."""
    angles = np.concatenate([[0.0], samples.fold_angles()])
    positions = np.repeat(samples.REST[np.newaxis], len(angles), axis=0)
    positions[:, 3] = np.stack([np.cos(angles), 0.0 * angles, np.sin(angles)], axis=1)
    return {"positions": positions, "unit": "mm", "time": np.arange(len(angles))}


TRUTHS = {"merlin": truth}
PRODUCERS = openprc_producers()
CASES = [
    *(
        ImporterCase(spec, truth=TRUTHS.get(spec.name), heavy=("scipy",))
        for spec in PRODUCERS
        if "import" in spec.capabilities
    ),
    *(RunnerCase(spec) for spec in PRODUCERS if "run" in spec.capabilities),
    *(
        ExporterCase(spec, importer=spec.name if spec.name == "fold" else None)
        for spec in openprc_exporters()
    ),
]


@parametrize_with_checks(CASES)
def test_conforms(case, check, tmp_path):
    check(case, tmp_path)
