"""What a plugin's check of its subtree may do wrong; see also test_validating.py."""

from __future__ import annotations

import h5py
import numpy as np
import pytest

from openprc.hooks import ExtensionSpec, Registry
from openprc.hooks.validating import validate_run
from openprc.schema import Provenance, TrajectoryWriter


@pytest.fixture
def run(tmp_path):
    path = tmp_path / "run.h5"
    with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
        writer.declare_nodes(1, 2, unit="m")
        writer.declare_extension("openprc-fake", "1.0")
        writer.put_extension("openprc-fake", "x", np.zeros(3))
        writer.append([0.0, 0.1], positions=[[[0.0, 0.0]], [[1.0, 1.0]]])
    return path


@pytest.fixture
def validate(make_entry, make_code, run):
    """Return a function that validates the run with a check of its extension."""

    def call(check, *, path=run):
        spec = ExtensionSpec("openprc-fake", "A fake", make_code("check", check))
        return validate_run(path, registry=Registry([make_entry(openprc_extensions=[spec])]))

    return call


def raising(error):
    def check(trajectory):
        raise error

    return check


@pytest.mark.parametrize(
    ("check", "words"),
    [
        (raising(SystemExit(0)), "SystemExit: 0"),
        (lambda trajectory: [None], "it yielded a NoneType, not a Finding"),
        (lambda: [], "TypeError"),
    ],
)
def test_a_check_that_fails_is_a_warning(validate, check, words):
    report = validate(check)
    (finding,) = [f for f in report.findings if f.code == "OPS-X03"]
    assert finding.level == "warning"
    assert words in finding.found
    assert report.ok


def test_ctrl_c_passes(validate):
    with pytest.raises(KeyboardInterrupt):
        validate(raising(KeyboardInterrupt()))


def test_an_invalid_file_is_not_shown_to_plugins(validate, run):
    with h5py.File(run, "r+") as file:
        file.attrs["dims"] = 3
    report = validate(raising(AssertionError("shown")))
    assert {f.code for f in report.findings if f.level == "error"} == {"OPS-R07"}
    assert not [f for f in report.findings if f.code.startswith("OPS-X")]
