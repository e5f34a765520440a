"""The kit on the importer and the runner for PyBullet; the recorder has a file of its own."""

from openprc_pybullet import openprc_producers

from openprc.testing import ImporterCase, RunnerCase, parametrize_with_checks

(SPEC,) = openprc_producers()
CASES = [
    ImporterCase(SPEC),
    RunnerCase(SPEC, slow=("RUN-7",)),
]


@parametrize_with_checks(CASES)
def test_conforms(case, check, tmp_path):
    check(case, tmp_path)
