"""The kit is tested by faults: each check is tripped by one, and the good plugins pass all."""

from __future__ import annotations

import fault_matrix
import pytest
from fault_matrix import FAULTS, GOOD, tripped

from openprc.testing import all_checks, checks_for


def by_name(fault):
    return fault.name.replace(" ", "-")


def quick(case):
    """Return ids of the checks that need no process of their own."""
    return {check.id for check in checks_for(case) if not check.apart}


def test_every_check_has_a_fault_and_every_fault_a_check():
    known = {check.id for check in all_checks()}
    reached = {name for fault in FAULTS for name in fault.trips}
    assert reached == known
    assert all(fault.trips for fault in FAULTS)
    names = [fault.name for fault in FAULTS]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("kind", GOOD)
def test_the_good_plugin_passes_all(kind, tmp_path):
    case = GOOD[kind]()
    states = {}
    for check in checks_for(case):
        folder = tmp_path / check.id
        folder.mkdir()
        outcome = check.run(case, folder)
        states[check.id] = (outcome.state, outcome.found)
    assert {name: told for name, told in states.items() if told[0] == "failed"} == {}
    # What is skipped is skipped for a reason of the case, and is no more than this.
    skipped = {name for name, told in states.items() if told[0] == "skipped"}
    assert skipped <= {"LIGHT-3", "PHYS-8"}


@pytest.mark.parametrize("fault", FAULTS, ids=by_name)
def test_a_fault_trips_its_checks(fault):
    case = fault.make()
    found = tripped(case, only=set(fault.trips))
    assert set(found) == set(fault.trips)
    for outcome in found.values():
        assert outcome.found
        assert outcome.expected
        assert outcome.fix


@pytest.mark.slow
@pytest.mark.parametrize("fault", FAULTS, ids=by_name)
def test_a_fault_trips_nothing_else(fault):
    case = fault.make()
    apart = any(check.apart for check in checks_for(case) if check.id in fault.trips)
    assert set(tripped(case, apart=apart)) == set(fault.trips)


def test_the_matrix_is_a_table_with_a_row_for_every_fault():
    text = fault_matrix.as_markdown()
    assert text.count("\n| ") == len(FAULTS)
    assert f"{len(FAULTS)} faults, {len(all_checks())} of {len(all_checks())} checks" in text
