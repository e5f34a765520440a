"""The kit on the H5MD importer and exporter."""

from openprc_h5md import openprc_exporters, openprc_producers

from openprc.testing import ExporterCase, ImporterCase, parametrize_with_checks

CASES = [
    *(ImporterCase(spec) for spec in openprc_producers()),
    *(ExporterCase(spec, importer="h5md") for spec in openprc_exporters()),
]


@parametrize_with_checks(CASES)
def test_conforms(case, check, tmp_path):
    check(case, tmp_path)
