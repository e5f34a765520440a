"""From a folder to a valid simulation.h5: channels, clock, input, extension, sample."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from openprc_prcpy import openprc_extensions, openprc_producers, read_prcpy, samples
from openprc_prcpy.extension import check
from openprc_prcpy.importer import Importer

from openprc.schema import Provenance, Trajectory, TrajectoryWriter, validate_file

NAMES = {"xs": "Frequency", "readouts": "Spectra"}


@pytest.fixture
def sample(tmp_path):
    (tmp_path / "native").mkdir()
    return samples.write_sample(tmp_path / "native")


def notes(run):
    return "\n".join(run.provenance["notes"])


def test_the_sample_is_the_closed_form(sample, run_import):
    run = run_import(sample.path, **sample.options)
    np.testing.assert_allclose(run.channel("Spectra"), samples.spectra(), atol=1e-14)
    assert run.channel_columns("Spectra")[:2] == ("r0", "r1")
    np.testing.assert_array_equal(run.time, samples.INTERVAL * np.arange(1, 301))
    assert (run.time_kind, run.time_unit, run.dt) == ("physical", "s", samples.INTERVAL)
    drive = run.input("u")
    np.testing.assert_array_equal(drive.value[:, 0], samples.fields())
    np.testing.assert_array_equal(drive.sequence[:, 0], samples.fields())
    assert (drive.hold, drive.start, drive.unit) == (2.0, 1.0, "mT")
    assert run.dims == 0
    np.testing.assert_array_equal(run.extension("openprc-prcpy", "xs"), samples.frequencies())
    assert "old_scan_1_50_0mT.txt (contains the prefix" in notes(run)
    report = validate_file(run.path)
    assert [f.code for f in report.findings if f.level != "hint"] == []
    assert list(check(run)) == []


def test_the_sample_remembers_and_bends(sample, run_import):
    """The spectra hold the fields of this scan and of those before, squares and products."""
    run = run_import(sample.path, **sample.options)
    states, u = run.channel("Spectra")[50:], run.input("u").value[:, 0]
    u = (u - u.mean()) / u.std()
    basis = np.linalg.qr(states - states.mean(axis=0))[0]

    def share(target):
        z = target - target.mean()
        return np.sum((basis.T @ z) ** 2) / np.sum(z**2)

    assert share(u[50:]) > 0.999
    assert share(u[48:-2]) > 0.9
    assert share(u[50:] ** 2) > 0.999
    assert share(u[50:] * u[49:-1]) > 0.99
    # Of what has nothing to do with them, 49 columns explain 49 parts in 249 by chance.
    assert share(np.random.default_rng(0).normal(size=250)) < 0.35


def test_every_scan_is_the_state_of_its_own_symbol(sample, run_import):
    from openprc.reservoir.io.symbol_clock import symbol_clock

    run = run_import(sample.path, **sample.options)
    drive = run.input("u")
    clock = symbol_clock(
        name="u", sequence=drive.sequence, hold=drive.hold, start=drive.start, time=run.time,
        columns=drive.columns,
    )  # fmt: skip
    np.testing.assert_array_equal(clock.frames, np.arange(300))
    np.testing.assert_array_equal(clock.sequence, drive.value)
    np.testing.assert_array_equal(clock.sample(drive.value)[0], drive.sequence)


def test_without_an_interval_scans_are_counted(folder, scans, run_import):
    _, spectra = scans(6)
    run = run_import(folder, **NAMES)
    assert (run.time_kind, run.time_unit) == ("pseudo", "1")
    np.testing.assert_array_equal(run.time, np.arange(1.0, 7.0))
    np.testing.assert_array_equal(run.channel("Spectra"), spectra)
    assert (run.input().hold, run.input().start) == (1.0, 0.5)
    assert "interval=SECONDS" in notes(run)
    assert validate_file(run.path).ok


def test_devices_in_time(folder, write, run_import):
    t = 0.002 * np.arange(30)
    for k in range(4):
        write(f"device_{k + 1}.txt", delimiter="\t", t=t, **{"Voltage (mV)": np.cos(t + k)})
    run = run_import(folder, transpose=True)
    assert (run.time_kind, run.time_unit, run.dt) == ("physical", "s", 0.002)
    assert run.channels == ("Voltage _mV_",)
    assert run.unit("/time_series/channels/Voltage _mV_") == "mV"
    assert run.channel_columns("Voltage _mV_") == ("device_1", "device_2", "device_3", "device_4")
    np.testing.assert_array_equal(run.channel("Voltage _mV_")[:, 2], np.cos(t + 2))
    assert run.inputs == ()
    assert "the header 't' has no unit; seconds were assumed" in notes(run)
    assert list(check(run)) == []


@pytest.mark.parametrize(
    ("header", "options", "kind", "unit"),
    [
        ("Elapsed [ms]", {}, "physical", "ms"),
        ("tick", {"time_unit": "us"}, "physical", "us"),
        ("Frequency", {}, "pseudo", "1"),
    ],
)
def test_columns_of_time(folder, write, run_import, header, options, kind, unit):
    for k in (1, 2):
        write(f"dev_{k}.txt", **{header: [5.0, 6.0, 8.0], "V": [1, 2, 3 + k]})
    run = run_import(folder, transpose=True, **options)
    assert (run.time_kind, run.time_unit) == (kind, unit)
    expected = [0.0, 1.0, 2.0] if kind == "pseudo" else [5.0, 6.0, 8.0]
    assert run.time.tolist() == expected


def test_units_of_inputs_that_are_not_in_the_list(folder, write, run_import):
    for k in range(3):
        write(f"scan_{k + 1}_{k}_5GHz.txt", f=[0, 1, 2], s=[k, 1, 2])
    run = run_import(folder, unit="mV")
    assert (run.input().unit, run.unit("/time_series/channels/s")) == ("arb", "mV")
    assert "the input is in 'GHz', which is no unit of the contract" in notes(run)


def test_a_background_from_elsewhere_is_named_as_a_source(folder, scans, write, run_import):
    f, spectra = scans(3)
    (folder.parent / "shared").mkdir()
    write("BG.txt", Frequency=f, Spectra=f).rename(folder.parent / "shared" / "BG.txt")
    run = run_import(folder, **NAMES, remove_bg=True, bg_fname="../shared/BG.txt")
    np.testing.assert_array_equal(run.channel("Spectra"), spectra - f)
    assert [item["name"] for item in run.provenance["inputs"]] == ["BG.txt"]


@pytest.mark.parametrize(("n_values", "codes"), [(2, []), (3, ["PRCPY-01"])])
def test_the_axis_has_a_value_for_each_column(tmp_path, n_values, codes):
    with TrajectoryWriter(tmp_path / "run.h5", provenance=Provenance("prcpy")) as writer:
        writer.declare_channel("s", ["r0", "r1"], unit="1")
        writer.declare_extension("openprc-prcpy", "1.0")
        writer.put_extension("openprc-prcpy", "xs", np.arange(float(n_values)))
        writer.append([0.0, 0.1], channels={"s": np.zeros((2, 2))})
    with Trajectory(tmp_path / "run.h5") as run:
        findings = list(check(run))
    assert [finding.code for finding in findings] == codes
    assert all("3 values of the sweep axis" in finding.found for finding in findings)


def test_the_entry_module_is_light():
    code = (
        "import sys, openprc_prcpy as p; p.openprc_producers(); p.openprc_extensions(); "
        "heavy = {'numpy', 'scipy', 'h5py', 'openprc_prcpy.experiment'} & set(sys.modules); "
        "sys.exit(', '.join(heavy) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_records_name_code_that_exists():
    for record in [*openprc_producers(), *openprc_extensions()]:
        module, _, attribute = record.load.partition(":")
        __import__(module)
        assert callable(getattr(sys.modules[module], attribute))


def test_the_python_of_the_readme_runs(sample, monkeypatch):
    monkeypatch.chdir(sample.path.parent)
    readme = Path(__file__).resolve().parents[1] / "README.md"
    (block,) = re.findall(r"^```python\n(.*?)^```", readme.read_text(), re.DOTALL | re.MULTILINE)
    names = {}
    exec(block, names)
    again = read_prcpy("skyrmion", "scan", names["params"])
    np.testing.assert_array_equal(names["data"].states, again.states)
    assert again.states.shape == (300, 4)
    np.testing.assert_array_equal(names["data"].input, samples.fields())


def test_a_number_of_the_device_is_no_axis(folder, write, run_import):
    """Recordings of devices whose first column is the device, row after row."""
    for k in range(1, 13):
        write(f"scan_{k}.txt", delimiter="\t", t=[k, k, k, k], Voltage=[0.1, 0.4 * k, 0.2, -k])
    params = {"Xs": "t", "Readouts": "Voltage", "transpose": True}
    data = read_prcpy(folder, "scan", params)
    assert data.states.shape == (4, 12)
    np.testing.assert_array_equal(data.states[3], -np.arange(1.0, 13.0))
    np.testing.assert_array_equal(data.xs, [0, 1, 2, 3])
    assert any("'t' is one number all along each file (1 in scan_1.txt)" in r for r in data.remarks)
    assert Importer().sniff(folder) == 0.7
    run = run_import(folder, transpose=True, xs="t", readouts="Voltage")
    assert run.time_kind == "pseudo"
    assert "the rows are counted" in notes(run)
