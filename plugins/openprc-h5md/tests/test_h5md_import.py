"""Files of other programs: the two clocks, periodic boxes, units, and what is refused."""

from __future__ import annotations

import re
from pathlib import Path

import h5py
import numpy as np
import pytest
from openprc_h5md import samples
from openprc_h5md.importer import H5mdImporter
from openprc_h5md.unit_names import from_contract, to_contract

from openprc.errors import ConfigError, SchemaError, UnitError
from openprc.hooks import import_file
from openprc.schema import Trajectory


@pytest.fixture
def foreign(tmp_path):
    """Return a function that writes a file of another program and imports it."""

    def make(change=None, *, frames=5, unit="nm", time_unit="ps", name="a.h5md", **options):
        path = tmp_path / name
        with h5py.File(path, "w") as file:
            file.create_group("h5md").attrs["version"] = [1, 0]
            group = file.create_group("particles/all")
            group.create_group("box").attrs.update({"dimension": 3, "boundary": [b"none"] * 3})
            place = group.create_group("position")
            place["step"] = np.arange(frames) * 100
            place["time"] = np.arange(frames) * 0.5
            place["value"] = np.arange(frames * 6.0).reshape(frames, 2, 3)
            if time_unit:
                place["time"].attrs["unit"] = time_unit
            if unit:
                place["value"].attrs["unit"] = unit
            if change:
                change(file)
        run = import_file(path, tmp_path / "out.h5", options=options, overwrite=True)
        return run, Trajectory(tmp_path / "out.h5")

    return make


def test_the_sample_is_its_closed_form(tmp_path):
    sample = samples.write_sample(tmp_path)
    run = import_file(sample.path, tmp_path / "out.h5")
    assert (run.producer, run.confidence) == ("h5md", 1.0)
    with Trajectory(tmp_path / "out.h5") as found:
        np.testing.assert_allclose(found.time, samples.times(), rtol=1e-15)
        np.testing.assert_allclose(found.positions(), 1e-9 * samples.positions(), rtol=1e-15)
        assert found.position_unit == "m"
        assert len(found.indices("bars")) == samples.N_BEADS - 1


def test_units_become_those_of_the_contract(foreign):
    _, found = foreign()
    with found:
        assert (found.position_unit, found.time_unit) == ("m", "s")
        np.testing.assert_allclose(found.time, 0.5e-12 * np.arange(5), rtol=1e-15)
        np.testing.assert_allclose(found.positions().ravel(), 1e-9 * np.arange(30.0), rtol=1e-15)


@pytest.mark.parametrize("offset", [None, 7.0])
def test_a_clock_of_one_increment(foreign, offset):
    def change(file):
        place = file["particles/all/position"]
        del place["time"], place["step"]
        place["time"], place["step"] = 0.25, 10
        place["time"].attrs["unit"] = "s"
        if offset is not None:
            place["time"].attrs["offset"] = offset

    _, found = foreign(change)
    with found:
        np.testing.assert_allclose(found.time, (offset or 0.0) + 0.25 * np.arange(5), rtol=1e-15)


def test_steps_alone_are_no_time(foreign):
    def change(file):
        del file["particles/all/position/time"]

    run, found = foreign(change)
    with found:
        assert found.time_kind == "pseudo"
        assert found.time.tolist() == [0, 100, 200, 300, 400]
    assert any("steps are the clock" in note for note in run.notes)


def crossing(file):
    """A particle that walks through the wall of a box of edge 1 and comes in again."""
    group = file["particles/all"]
    del group["box"], group["position/value"]
    group.create_group("box").attrs.update({"dimension": 3, "boundary": [b"periodic"] * 3})
    group["box/edges"] = [1.0, 1.0, 1.0]
    path = np.zeros((5, 2, 3))
    path[:, 0, 0] = 0.7 * np.arange(5)
    group["position/value"] = path % 1.0
    group["position/value"].attrs["unit"] = "mm"
    image = group.create_group("image")
    image["step"], image["time"] = group["position/step"], group["position/time"]
    image["value"] = np.floor(path).astype("i4")


def test_crossings_of_a_periodic_box_are_added_back(foreign):
    _, found = foreign(crossing)
    with found:
        np.testing.assert_allclose(found.positions()[:, 0, 0], 0.7 * np.arange(5), rtol=1e-15)


def test_a_periodic_box_without_images_is_refused(foreign):
    def change(file):
        crossing(file)
        del file["particles/all/image"]

    with pytest.raises(ConfigError, match="periodic along x, y, z"):
        foreign(change)
    _, found = foreign(change, wrapped="true")
    with found:
        assert found.positions()[2, 0, 0] == pytest.approx(0.4)


def test_observables_on_the_clock_become_channels(foreign):
    def change(file):
        for name, steps in (("temperature", np.arange(5) * 100), ("rare", np.arange(2))):
            group = file.create_group(f"observables/{name}")
            group["step"], group["time"] = steps, steps * 1.0
            group["value"] = np.arange(float(len(steps)))
            group["value"].attrs["unit"] = "K"

    run, found = foreign(change)
    with found:
        assert found.channels == ("temperature",)
        assert found.unit("/time_series/channels/temperature") == "K"
    assert any("left out" in note and "rare" in note for note in run.notes)


def no_value(file):
    del file["particles/all/position/value"]


def short_clock(file):
    del file["particles/all/position/time"]
    file["particles/all/position/time"] = np.arange(3.0)


def two_groups(file):
    file.copy("particles/all", "particles/more")


def still(file):
    del file["particles/all/position"]


def repeated(file):
    file["particles/all/id"] = [4, 4]


def changing(file):
    group = file.create_group("particles/all/id")
    group["step"], group["value"] = np.arange(5), [[0, 1], [1, 0]] + [[0, 1]] * 3


@pytest.mark.parametrize(
    ("change", "error", "words"),
    [
        (no_value, SchemaError, "no value that changes with time"),
        (short_clock, SchemaError, r"shape \(3,\) beside 5 values"),
        (two_groups, SchemaError, "2 particles groups with positions: all, more"),
        (still, SchemaError, "0 particles groups with positions: none"),
        (repeated, SchemaError, "ids that repeat"),
        (changing, ConfigError, "change their places"),
    ],
)
def test_files_that_do_not_keep_the_format(foreign, tmp_path, change, error, words):
    with pytest.raises(error, match=words):
        foreign(change)
    assert not list(tmp_path.glob("out.h5*"))


def test_one_of_several_groups(foreign):
    _, found = foreign(two_groups, group="more")
    with found:
        assert found.n_nodes == 2
    with pytest.raises(SchemaError, match="no particles group 'none'"):
        foreign(two_groups, group="none")


def test_units_that_are_not_there_are_given_by_options(tmp_path):
    with h5py.File(samples.write_sample(tmp_path).path, "r+") as file:
        place = file["particles/beads/position"]
        del place["value"].attrs["unit"], place["time"].attrs["unit"]
    options = {"unit": "mm", "time_unit": "ms"}
    import_file(tmp_path / "beads.h5md", tmp_path / "out.h5", options=options)
    with Trajectory(tmp_path / "out.h5") as found:
        assert (found.position_unit, found.time_unit) == ("mm", "ms")
        np.testing.assert_array_equal(found.positions(), samples.positions())


def test_units_that_are_not_there_are_asked_for(foreign):
    with pytest.raises(ConfigError, match="which unit its positions are"):
        foreign(unit=None)
    with pytest.raises(ConfigError, match="which unit its time is"):
        foreign(time_unit=None)
    with pytest.raises(UnitError, match="unknown unit 'furlong'"):
        foreign(unit="furlong")


def test_sniffing(tmp_path):
    importer = H5mdImporter()
    sample = samples.write_sample(tmp_path)
    assert importer.sniff(sample.path) == 1.0
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = 1
    (tmp_path / "text.h5md").write_text("no")
    (tmp_path / "cut.h5md").write_bytes(sample.path.read_bytes()[:2000])
    assert importer.sniff(tmp_path / "other.h5") == 0.0
    assert importer.sniff(tmp_path / "text.h5md") == 0.3
    assert importer.sniff(tmp_path / "cut.h5md") == 0.3
    assert importer.sniff(tmp_path / "absent.h5md") == 0.3
    assert importer.sniff(tmp_path) == 0.0


@pytest.mark.parametrize("symbol", ["m", "mm/s", "N*m/rad", "kg*m2", "1/s", "N*s3/m3", "1", "arb"])
def test_spelling_of_units_there_and_back(tmp_path, symbol):
    spelled = from_contract(symbol)
    assert "/" not in spelled
    assert "*" not in spelled
    found, factor = to_contract(spelled, file=tmp_path, key="")
    if symbol != "mm/s":
        assert (found, factor) == (symbol, 1.0)
    else:
        assert (found, factor) == ("m/s", 1e-3)


def test_code_of_the_readme_runs(tmp_path, monkeypatch):
    text = (Path(__file__).parents[1] / "README.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"```python\n(.*?)```", text, flags=re.DOTALL)
    monkeypatch.chdir(tmp_path)
    exec(compile(block, "README.md", "exec"), {"__name__": "readme"})
    with h5py.File("swing.h5md") as file:
        assert file["particles/trajectory/position/value"].shape == (50, 2, 3)
