"""The kit on the H5MD importer and exporter."""

from openprc_h5md import openprc_exporters, openprc_producers, samples

from openprc.testing import ExporterCase, ImporterCase, parametrize_with_checks


def truth():
    return {"time": samples.times(), "positions": samples.positions() * 1e-9, "unit": "m"}


CASES = [
    *(ImporterCase(spec, truth=truth) for spec in openprc_producers()),
    *(ExporterCase(spec, importer="h5md") for spec in openprc_exporters()),
]


@parametrize_with_checks(CASES)
def test_conforms(case, check, tmp_path):
    check(case, tmp_path)
