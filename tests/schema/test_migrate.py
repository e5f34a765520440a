"""From one major version to the next, with a step made up here: there is no older one yet."""

from __future__ import annotations

import h5py
import pytest

from openprc.errors import ResultExists, SchemaError, SchemaTooNew, SchemaTooOld, UnreadableFile
from openprc.schema import Trajectory, validate_file
from openprc.schema.migrate import STEPS, migrate, stated_version


@pytest.fixture
def old(complete):
    """The complete file as a version 0 might have stored it: other name, no unit factor."""
    with h5py.File(complete, "r+") as file:
        file.attrs["openprc_schema"] = "0.3"
        file.move("time_series/system/kinetic_energy", "time_series/system/ekin")
        del file["time_series/nodes/positions"].attrs["si_factor"]
    return complete


def from_0_to_1(file):
    file.move("time_series/system/ekin", "time_series/system/kinetic_energy")
    file["time_series/nodes/positions"].attrs["si_factor"] = 1.0


def test_step_makes_a_valid_copy(old, tmp_path, complete_template):
    before = old.read_bytes()
    with pytest.raises(SchemaTooOld, match="openprc migrate"):
        Trajectory(old)
    new = migrate(old, tmp_path / "new.h5", steps={0: from_0_to_1})
    assert old.read_bytes() == before
    assert validate_file(new).findings == ()
    with Trajectory(new) as trajectory, Trajectory(complete_template) as original:
        assert trajectory.content_digest() == original.content_digest()
        assert trajectory.run_id == original.run_id
    assert stated_version(new) == (1, 0)


def test_steps_follow_each_other(old, tmp_path):
    seen = []
    steps = {
        0: lambda file: seen.append(("0", file.attrs["openprc_schema"])),
        1: lambda file: seen.append(("1", file.attrs["openprc_schema"])),
    }
    new = migrate(old, tmp_path / "new.h5", to=2, steps=steps)
    assert seen == [("0", "0.3"), ("1", "1.0")]
    assert stated_version(new) == (2, 0)


def test_no_step_exists_yet(old, tmp_path):
    assert STEPS == {}
    with pytest.raises(SchemaTooOld, match=r"no way from schema 0 to 1[\s\S]*import its source"):
        migrate(old, tmp_path / "new.h5")
    assert not (tmp_path / "new.h5").exists()


def test_missing_step_in_the_middle(old, tmp_path):
    with pytest.raises(SchemaTooOld, match="no way from schema 1 to 2"):
        migrate(old, tmp_path / "new.h5", to=2, steps={0: from_0_to_1})
    assert list(tmp_path.iterdir()) == [old]


def test_current_file_is_refused(small, tmp_path):
    with pytest.raises(SchemaError, match=r"at version 1\.0 already"):
        migrate(small, tmp_path / "new.h5")


def test_newer_file_is_refused(small, tmp_path, edit):
    with edit(small) as file:
        file.attrs["openprc_schema"] = "4.0"
    with pytest.raises(SchemaTooNew, match=r"schema 4\.0"):
        migrate(small, tmp_path / "new.h5")


@pytest.mark.parametrize(
    ("version", "words"), [(None, "states no version"), ("x", "the version is 'x'")]
)
def test_file_without_a_version(small, tmp_path, edit, version, words):
    with edit(small) as file:
        del file.attrs["openprc_schema"]
        if version:
            file.attrs["openprc_schema"] = version
    with pytest.raises(SchemaError, match=words):
        migrate(small, tmp_path / "new.h5")


def test_what_is_no_hdf5(tmp_path):
    (tmp_path / "x.h5").write_text("text")
    with pytest.raises(UnreadableFile, match="this is not HDF5"):
        migrate(tmp_path / "x.h5", tmp_path / "new.h5")


def test_failing_step_leaves_nothing(old, tmp_path):
    def fail(_):
        raise KeyError("what the step needs")

    with pytest.raises(KeyError):
        migrate(old, tmp_path / "new.h5", steps={0: fail})
    assert list(tmp_path.iterdir()) == [old]


def test_existing_target_is_refused_and_replaced_on_demand(old, make_small, tmp_path):
    target = make_small("taken.h5")
    before = target.read_bytes()
    with pytest.raises(ResultExists):
        migrate(old, target, steps={0: from_0_to_1})
    assert target.read_bytes() == before
    migrate(old, target, steps={0: from_0_to_1}, overwrite=True)
    with Trajectory(target) as trajectory:
        assert trajectory.n_frames == 12
