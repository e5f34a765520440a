"""The kit on the PRCpy importer."""

import numpy as np
from openprc_prcpy import openprc_producers, samples

from openprc.testing import ImporterCase, parametrize_with_checks


def truth():
    """What the sample holds: spectra without background, a row at the end of each scan."""
    return {
        "time": samples.INTERVAL * np.arange(1, samples.N_SCANS + 1),
        "channels": {"Spectra": samples.spectra()},
        "tolerance": 1e-9,
    }


CASES = [ImporterCase(spec, truth=truth, heavy=("pandas",)) for spec in openprc_producers()]


@parametrize_with_checks(CASES)
def test_conforms(case, check, tmp_path):
    check(case, tmp_path)
