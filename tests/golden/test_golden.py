"""Files of every schema version so far: they must open, be valid, and say the same for ever."""

from __future__ import annotations

import importlib.util
import json
import warnings
from pathlib import Path

import h5py
import numpy as np
import pytest

from openprc.errors import ResultExists
from openprc.schema import SCHEMA_VERSION, Trajectory, validate_file
from openprc.schema.derive import attach_input, pack
from openprc.schema.describe import describe

HERE = Path(__file__).resolve().parent
VERSIONS = sorted(folder.name for folder in HERE.glob("v*.*"))
FILES = [
    pytest.param(path, id=f"{path.parent.name}-{path.stem}")
    for version in VERSIONS
    for path in sorted((HERE / version).glob("*.h5"))
]


@pytest.fixture(scope="module")
def make_golden():
    spec = importlib.util.spec_from_file_location("make_golden", HERE / "make_golden.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def recorded(path):
    return json.loads((path.parent / "expected.json").read_text(encoding="utf-8"))[path.stem]


def test_present_version_has_its_files(make_golden):
    assert f"v{SCHEMA_VERSION}" in VERSIONS
    for version in VERSIONS:
        names = {path.stem for path in (HERE / version).glob("*.h5")}
        assert names == set(json.loads((HERE / version / "expected.json").read_text("utf-8")))
    assert {p.stem for p in (HERE / f"v{SCHEMA_VERSION}").glob("*.h5")} == set(
        make_golden.PRODUCERS
    )


@pytest.mark.parametrize("path", FILES)
def test_golden_file_gives_the_recorded_values(path, make_golden):
    assert make_golden.expectations(path) == recorded(path)


@pytest.mark.parametrize("path", FILES)
def test_golden_file_is_valid_without_a_warning_about_its_version(path):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        report = validate_file(path)
    assert report.at_least("error") == ()
    assert not [finding for finding in report.findings if finding.code.startswith("OPS-F")]


@pytest.mark.parametrize("path", FILES)
def test_golden_file_can_be_worked_with(path, tmp_path):
    before = path.read_bytes()
    assert describe(path)["n_frames"] == recorded(path)["n_frames"]
    pack(path, tmp_path / "packed.h5")
    with Trajectory(path) as old, Trajectory(tmp_path / "packed.h5") as new:
        assert new.content_digest() == old.content_digest()
    signal = np.arange(float(recorded(path)["n_frames"]))
    attach_input(path, tmp_path / "more.h5", name="new", signal=signal, unit="1", quantity="x")
    assert validate_file(tmp_path / "more.h5").ok
    assert path.read_bytes() == before


@pytest.mark.parametrize("path", FILES)
def test_golden_file_states_the_version_of_its_folder(path):
    with h5py.File(path) as file:
        assert f"v{file.attrs['openprc_schema']}" == path.parent.name


def test_writer_of_today_says_the_same_as_the_golden_files(make_golden, tmp_path):
    """Only as long as the version stays: a new minor version may add to what is written."""
    for producer, make in make_golden.PRODUCERS.items():
        golden = HERE / f"v{SCHEMA_VERSION}" / f"{producer}.h5"
        make(tmp_path / f"{producer}.h5")
        fresh = make_golden.expectations(tmp_path / f"{producer}.h5")
        wanted = recorded(golden)
        # The last bit of a sine may differ between machines; names and numbers may not.
        for key in set(wanted) - {"digest", "run_id", "last_positions", "channels", "inputs"}:
            assert fresh[key] == wanted[key], (producer, key)
        if golden.stem in ("vision", "csv", "merlin"):  # no transcendental function in these
            assert fresh["digest"] == wanted["digest"], producer


def test_golden_files_are_small_and_are_not_replaced(make_golden):
    for param in FILES:
        (path,) = param.values
        assert path.stat().st_size < 100_000
        make = make_golden.PRODUCERS[path.stem]
        before = path.read_bytes()
        with pytest.raises(ResultExists):
            make(path)
        assert path.read_bytes() == before
