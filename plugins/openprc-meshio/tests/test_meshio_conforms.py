"""The kit on the mesh importer and the exporters for ParaView."""

from openprc_meshio import openprc_exporters, openprc_producers, samples

from openprc.testing import ExporterCase, ImporterCase, parametrize_with_checks


def truth():
    return {"positions": samples.positions(), "time": samples.times(), "unit": "mm"}


CASES = [
    *(ImporterCase(spec, heavy=("meshio",), truth=truth) for spec in openprc_producers()),
    *(ExporterCase(spec, importer="meshio") for spec in openprc_exporters()),
]


@parametrize_with_checks(CASES)
def test_conforms(case, check, tmp_path):
    check(case, tmp_path)
