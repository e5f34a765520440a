"""The kit on the example plugin: what an author's own test file looks like."""

import numpy as np
from openprc_example import openprc_exporters, openprc_producers, samples

from openprc.testing import ExporterCase, ImporterCase, parametrize_with_checks


def truth():
    """What the sample holds, in closed form."""
    return {
        "positions": samples.positions(),
        "unit": "mm",
        "time": samples.times(),
        "inputs": {"u": samples.symbols_at_frames()},
        "sequences": {"u": samples.symbols()},
        "channels": {"angle": samples.angles()},
        "observed": np.ones((len(samples.times()), samples.N_ARMS)),
    }


CASES = [
    *(ImporterCase(spec, truth=truth, heavy=("pandas",)) for spec in openprc_producers()),
    *(ExporterCase(spec) for spec in openprc_exporters()),
]


@parametrize_with_checks(CASES)
def test_conforms(case, check, tmp_path):
    check(case, tmp_path)
