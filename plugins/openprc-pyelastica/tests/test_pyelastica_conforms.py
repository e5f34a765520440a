"""The kit on the importer and the runner for PyElastica."""

from openprc_pyelastica import openprc_producers
from openprc_pyelastica.samples import driven_chain

from openprc.testing import ImporterCase, RunnerCase, parametrize_with_checks

(SPEC,) = openprc_producers()
CASES = [
    ImporterCase(SPEC, heavy=("elastica",)),
    # The simulator compiles for most of a minute where its cache cannot be written.
    # Elements turn quicker than the kit's steps, and bars keep their section when drawn out.
    RunnerCase(
        SPEC,
        scene=driven_chain,
        options={"substeps": "auto", "section": "constant"},
        slow=("RUN", "PHYS", "PIPE"),
    ),
]


@parametrize_with_checks(CASES)
def test_conforms(case, check, tmp_path):
    check(case, tmp_path)
