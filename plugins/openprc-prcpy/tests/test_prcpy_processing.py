"""The steps of PRCpy's processing, each against its own formula, and their order."""

from __future__ import annotations

import doctest

import numpy as np
import openprc_prcpy.experiment
import pytest
from openprc_prcpy import read_prcpy
from scipy.signal import savgol_filter

NAMES = {"Xs": "Frequency", "Readouts": "Spectra"}


@pytest.mark.parametrize(("delimiter", "quoted"), [(",", True), ("\t", False), (";", False)])
def test_raw_spectra_come_out_as_they_are(folder, scans, delimiter, quoted):
    f, spectra = scans(12, delimiter=delimiter, quoted=quoted)
    for given in ({}, {"delimiter": delimiter}):
        data = read_prcpy(folder, "scan", {**NAMES, **given})
        np.testing.assert_array_equal(data.states, spectra)
        np.testing.assert_array_equal(data.xs, f)
        assert data.names == tuple(f"r{k}" for k in range(40))
        assert data.files[0].startswith("scan_1_")
        assert data.files[9].startswith("scan_10_")
        np.testing.assert_array_equal(data.scans, np.arange(1, 13))


def test_all_steps_in_their_order(folder, scans, write):
    f, spectra = scans(5)
    background = 0.3 * np.cos(9.0 * f)
    # The background comes from another program: more columns, another delimiter.
    write("BG_4K.txt", delimiter="\t", Id=0 * f, Frequency=f, Spectra=background)
    params = {
        **NAMES, "remove_bg": True, "bg_fname": "BG_4K.txt", "smooth": True, "smooth_win": 7,
        "smooth_rank": 3, "cut_xs": True, "x1": f[10], "x2": f[25], "normalize_local": True,
        "normalize_global": False, "sample": True, "sample_rate": 3, "transpose": False,
    }  # fmt: skip
    data = read_prcpy(folder, "scan", {**params, "delimiter": ","})
    smooth = savgol_filter(spectra - background, 7, 3, axis=1)[:, 10:26]
    low, high = smooth.min(axis=1, keepdims=True), smooth.max(axis=1, keepdims=True)
    np.testing.assert_allclose(data.states, ((smooth - low) / (high - low))[:, ::3], atol=1e-14)
    np.testing.assert_array_equal(data.xs, f[10:26:3])
    assert data.names == ("r10", "r13", "r16", "r19", "r22", "r25")
    assert "BG_4K.txt" in data.left_out
    # Smoothing after the cut would see no samples outside it.
    late = savgol_filter((spectra - background)[:, 10:26], 7, 3, axis=1)
    assert np.abs(late - smooth).max() > 1e-6


def test_global_normalisation_keeps_the_scans_apart(folder, scans):
    _, spectra = scans(5)
    data = read_prcpy(folder, "scan", {**NAMES, "normalize_global": True})
    expected = (spectra - spectra.min()) / (spectra.max() - spectra.min())
    np.testing.assert_allclose(data.states, expected, atol=1e-15)
    both = read_prcpy(folder, "scan", {**NAMES, "normalize_global": True, "normalize_local": True})
    np.testing.assert_allclose(both.states.min(axis=1), 0.0, atol=1e-15)
    np.testing.assert_allclose(both.states.max(axis=1), 1.0, atol=1e-15)


def test_the_processing_of_another_readme(folder, scans):
    # A dictionary as users have it: everything is there, everything is off.
    _, spectra = scans(4)
    params = {
        "Xs": "Frequency", "Readouts": "Spectra", "remove_bg": False, "bg_fname": "",
        "smooth": False, "smooth_win": 51, "smooth_rank": 4, "cut_xs": False, "x1": 2, "x2": 5,
        "normalize": False, "normalize_local": np.bool_(False), "sample": False,
        "sample_rate": 13, "delimiter": ",", "transpose": False,
    }  # fmt: skip
    np.testing.assert_array_equal(read_prcpy(folder, "scan", params).states, spectra)


def test_devices_side_by_side(folder, write):
    t = 0.5 + 0.001 * np.arange(50)
    volts = np.stack([np.sin(40 * t + k) for k in range(11)], axis=1)
    for k in range(11):
        write(f"device_{k + 1}.txt", delimiter="\t", t=t, Voltage=volts[:, k])
    data = read_prcpy(folder, "device", {"transpose": True})
    np.testing.assert_array_equal(data.states, volts)
    np.testing.assert_array_equal(data.xs, t)
    assert data.names[:2] == ("device_1", "device_2")
    assert data.names[-1] == "device_11"
    assert data.input is None
    assert data.transpose


def test_inputs_of_the_names(folder, scans):
    scans(6)
    data = read_prcpy(folder, "scan", NAMES)
    np.testing.assert_allclose(data.input, [60 + k + 0.025 + 0.1 * k for k in range(6)])
    assert data.input_unit == "mT"
    assert read_prcpy(folder, "scan", NAMES, input_from="none").input is None


def test_some_names_without_a_value(folder, scans):
    scans(4)
    next(folder.glob("scan_2_*")).rename(folder / "scan_2.txt")
    data = read_prcpy(folder, "scan", NAMES)
    assert data.input is None
    assert "1 of 4 names carry no input value (the first is scan_2.txt)" in data.remarks[0]


def test_a_value_that_never_changes_is_a_setting(folder, write):
    for k in range(3):
        write(f"scan_{k + 1}_4K.txt", f=[0, 1, 2], s=[k, 1, 2])
    data = read_prcpy(folder, "scan", {})
    assert data.input is None
    assert data.remarks == ("every name says 4 K: a setting, not an input",)
    assert read_prcpy(folder, "scan", {}, input_from="names").input.tolist() == [4, 4, 4]


def test_what_follows_the_value_is_told(folder, write):
    for k in range(3):
        write(f"scan_{k + 1}_-{k}_5mA_0_to_-140mT.txt", f=[0, 1, 2], s=[k, 1, 2])
    data = read_prcpy(folder, "scan", {})
    assert data.input.tolist() == [-0.5, -1.5, -2.5]
    assert "not used ('_0_to_-140mT' in scan_1_" in data.remarks[0]


def test_axes_that_differ_by_rounding(folder, write):
    write("scan_1.txt", f=[1.0, 1.1, 1.2], s=[0, 1, 2])
    write("scan_2.txt", f=[1.0, 1.1001, 1.2], s=[3, 4, 5])
    data = read_prcpy(folder, "scan", {})
    assert data.xs.tolist() == [1.0, 1.1, 1.2]
    assert data.remarks == (
        "f differs between files by up to 0.0001 (scan_2.txt); that of scan_1.txt is used",
    )


def test_comments_blank_lines_and_a_byte_order_mark(folder):
    text = '\ufeff# instrument 7\n\n"f"; "s"\n1.0; 2.5\n\n1.5;"3e-1"\n'
    for k in (1, 2):
        (folder / f"scan_{k}.txt").write_text(text, encoding="utf-8")
    assert read_prcpy(folder, None, {}).states.tolist() == [[2.5, 0.3], [2.5, 0.3]]


def test_a_character_of_a_column_name_is_no_delimiter(folder):
    for k in (1, 2):
        (folder / f"scan_{k}.txt").write_text("f,s (a;b)\n1.0,2.5\n1.5,0.3\n")
    assert read_prcpy(folder, None, {}).states.tolist() == [[2.5, 0.3], [2.5, 0.3]]


def test_columns_separated_by_blanks(folder):
    for k in (1, 2):
        (folder / f"scan_{k}.txt").write_text("f   s\n1.0  2.5\n 1.5 0.3\n")
    assert read_prcpy(folder, None, {}).states.tolist() == [[2.5, 0.3], [2.5, 0.3]]
    for name in ("space", " "):
        assert read_prcpy(folder, None, {"delimiter": name}).xs.tolist() == [1.0, 1.5]


def test_every_file_is_read_once(folder, scans, monkeypatch):
    scans(5)
    read = []
    original = type(folder).read_text
    monkeypatch.setattr(
        type(folder), "read_text", lambda path, **k: read.append(path.name) or original(path, **k)
    )
    data = read_prcpy(folder, "scan", NAMES)
    assert tuple(read) == data.files


def test_the_example_of_the_docstring(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert doctest.testmod(openprc_prcpy.experiment) == doctest.TestResults(0, 6)
