"""The plugin's check of its own subtree."""

import numpy as np
import pytest
from openprc_pyelastica.extension import check

from openprc.schema import Provenance, Trajectory, TrajectoryWriter


@pytest.mark.parametrize(("bad", "codes"), [(None, []), (2, ["PYELASTICA-01"])])
def test_quantities_have_to_be_finite(tmp_path, bad, codes):
    sigma = np.zeros((3, 4, 3))
    if bad is not None:
        sigma[bad, 1, 0] = np.nan
    with TrajectoryWriter(tmp_path / "run.h5", provenance=Provenance("pyelastica")) as writer:
        writer.declare_nodes(1, 3, unit="m")
        writer.declare_extension("openprc-pyelastica", "1.0")
        writer.put_extension("openprc-pyelastica", "rod0.sigma", sigma)
        writer.append([0.0, 0.1, 0.2], positions=np.arange(9.0).reshape(3, 1, 3))
    with Trajectory(tmp_path / "run.h5") as run:
        findings = list(check(run))
    assert [finding.code for finding in findings] == codes
    assert all("from row 2 on" in finding.found for finding in findings)
