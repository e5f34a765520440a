"""Which versions are read, and what is said about the others."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

from openprc.errors import SchemaError, SchemaTooNew, SchemaTooOld
from openprc.schema import Trajectory, validate_file
from openprc.schema.layout import SCHEMA_MAJOR, SCHEMA_VERSION
from openprc.schema.version import NewerSchemaWarning, parse_version


def stamp(path, version):
    import h5py

    with h5py.File(path, "r+") as file:
        file.attrs["openprc_schema"] = version
    return path


def test_own_version_reads_without_a_word(small):
    with Trajectory(small) as trajectory:
        assert trajectory.n_frames == 3
    assert SCHEMA_VERSION.split(".")[0] == str(SCHEMA_MAJOR)


def test_newer_minor_version_reads_with_one_warning(small):
    stamp(small, "1.9")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        with Trajectory(small) as trajectory:
            assert trajectory.positions().shape == (3, 2, 2)
            trajectory.content_digest()
    assert [w.category for w in caught] == [NewerSchemaWarning]
    assert "schema 1.9 is newer than 1.0" in str(caught[0].message)


def test_newer_minor_version_is_a_warning_of_validation(small):
    stamp(small, "1.9")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        report = validate_file(small)
    assert report.ok
    assert [f.code for f in report.at_least("warning")] == ["OPS-F03"]


@pytest.mark.parametrize(
    ("version", "error", "words"),
    [
        ("2.0", SchemaTooNew, r"schema 2\.0[\s\S]*update openprc"),
        ("10.4", SchemaTooNew, r"schema 10\.4"),
        ("0.9", SchemaTooOld, r"schema 0\.9[\s\S]*openprc migrate"),
        ("1", SchemaError, "the version is '1'"),
        ("", SchemaError, "the version is ''"),
        ("1.0.0", SchemaError, "MAJOR.MINOR"),
        ("one.two", SchemaError, "MAJOR.MINOR"),
        (" 1.0", SchemaError, "MAJOR.MINOR"),
        ("-1.0", SchemaError, "MAJOR.MINOR"),
        ("9" * 5000 + ".0", SchemaError, "MAJOR.MINOR"),
        (1.0, SchemaError, "the version is"),
        (np.arange(2), SchemaError, "the version is"),
    ],
    ids=str,
)
def test_other_versions_are_refused(small, version, error, words):
    stamp(small, version)
    with pytest.raises(error, match=words) as caught:
        Trajectory(small)
    assert caught.value.key == "openprc_schema"
    (finding,) = validate_file(small).findings
    assert finding.code == ("OPS-F04" if error is SchemaError else "OPS-F03")


def test_bytes_are_text():
    assert parse_version(b"3.14", Path("x")) == (3, 14)
