"""Folders and parameters that are refused, by the words of the message."""

from __future__ import annotations

import numpy as np
import pytest
from openprc_prcpy import read_prcpy

from openprc.errors import ConfigError, MissingData, NonUniformTime, UnreadableFile

NAMES = {"Xs": "Frequency", "Readouts": "Spectra"}
F = np.linspace(1.0, 2.0, 11)


@pytest.mark.parametrize(
    ("params", "match"),
    [
        ({"smoth": True}, r"key 'smoth'(.|\n)*did you mean 'smooth'"),
        ({"xs": "Frequency", "Readout": "Spectra"}, "did you mean 'Readouts'"),
        ({"normalize": True}, "normalize is on(.|\n)*normalize_local or normalize_global"),
        ({"smooth": "yes"}, "smooth is 'yes'(.|\n)*True or False"),
        ({"smooth": True, "smooth_win": 5.0}, r"smooth_win is 5.0(.|\n)*a whole number"),
        ({"cut_xs": True, "x1": float("nan")}, "x1 is nan(.|\n)*a finite number"),
        ({"Xs": 3}, "Xs is 3(.|\n)*text"),
        ({"delimiter": "::"}, "delimiter is '::'(.|\n)*one character"),
        ({"transpose": True, "smooth": True, "sample": True}, "transpose together with smooth, sa"),
        ({"remove_bg": True}, "remove_bg is on and bg_fname is not given"),
        ({"remove_bg": True, "bg_fname": ""}, "remove_bg is on and bg_fname is not given"),
        ({"smooth": True, "smooth_win": 5}, "smooth is on and smooth_rank is not given"),
        ({"cut_xs": True, "x1": 1.0}, "cut_xs is on and x2 is not given"),
        ({"sample": True}, "sample is on and sample_rate is not given"),
        ({"sample": True, "sample_rate": 0}, "sample_rate is 0"),
        ({"smooth": True, "smooth_win": 3, "smooth_rank": 3}, "a window of 3 samples and a poly"),
        ({"smooth": True, "smooth_win": 99, "smooth_rank": 3}, "smooth_win is 99 and a sweep has"),
        ({"cut_xs": True, "x1": 7.0, "x2": 8.0}, "nothing lies between x1 = 7 and x2 = 8"),
        ({"Readouts": None}, "the columns are Field, Frequency, Spectra(.|\n)*Readouts"),
        ({"Readouts": "Frequency"}, "Xs and Readouts are both 'Frequency'"),
    ],
)
def test_parameters(folder, scans, params, match):
    scans(3)
    with pytest.raises(ConfigError, match=match) as caught:
        read_prcpy(folder, "scan", {**NAMES, **params})
    assert caught.value.file == str(folder) or "scan_1" in caught.value.file


@pytest.mark.parametrize(
    ("params", "match"),
    [
        ({"Readouts": "Spectrum"}, "no column 'Spectrum'(.|\n)*did you mean 'Spectra'"),
        ({"Xs": "q"}, "no column 'q'(.|\n)*Field, Frequency, Spectra"),
        ({"delimiter": ";"}, r"no column 'Frequency'(.|\n)*delimiter \(here ';'\)"),
        ({"remove_bg": True, "bg_fname": "BG.txt"}, "there is no background file 'BG.txt'"),
    ],
)
def test_what_is_not_there(folder, scans, params, match):
    scans(3)
    with pytest.raises(MissingData, match=match):
        read_prcpy(folder, "scan", {**NAMES, **params})


def test_scans_of_different_length(folder, write):
    write("scan_1.txt", f=F, s=F)
    write("scan_2.txt", f=F[:-1], s=F[:-1])
    with pytest.raises(UnreadableFile, match=r"scan_2.txt: 10 rows, and scan_1.txt has 11"):
        read_prcpy(folder, "scan", {})


def test_scans_on_different_axes(folder, write):
    write("scan_1.txt", f=F, s=F)
    write("scan_2.txt", f=F + 0.1, s=F)
    with pytest.raises(UnreadableFile, match=r"scan_2.txt: f is 1.1 in row 1, and 1 in scan_1"):
        read_prcpy(folder, "scan", {})


def test_a_background_that_does_not_fit(folder, write):
    for k in (1, 2):
        write(f"scan_{k}.txt", f=F, s=F)
    write("BG.txt", f=F[:4], s=F[:4])
    with pytest.raises(UnreadableFile, match="the background does not fit the scans: 4 rows"):
        read_prcpy(folder, "scan", {"remove_bg": True, "bg_fname": "BG.txt"})


@pytest.mark.parametrize("step", ["normalize_local", "normalize_global"])
def test_nothing_to_normalise(folder, write, step):
    for k in (1, 2):
        write(f"scan_{k}.txt", f=F, s=0 * F + 2.5)
    with pytest.raises(ConfigError, match=r"one value only, 2\.5"):
        read_prcpy(folder, "scan", {step: True})


@pytest.mark.parametrize(
    ("text", "match"),
    [
        ("f,s\n1,2\n2,nan\n", "line 3, column 's': 'nan' is not a finite number"),
        ("f,s\n1,2\n2,\n", "line 3, column 's': '' is not a finite number"),
        ("f,s\n1,2\n\n2\n", "line 4, column 's': the row ends before this column"),
        ("f,s\n1,2\n2,1_0\n", "line 3, column 's': '1_0' is not a finite number"),
        ("f,s\n1,2\n2,inf\n", "'inf' is not a finite number"),
        ("f;s\n1;2\n2;3,5\n", r"'3,5' is not a finite number \(decimal comma\)"),
        ("f,s\n1,2\nstopped\n", "line 3, column 'f': 'stopped'"),
        ("1,2\n2,3\n", "no header line was found"),
        ("# nothing\n\n", "no header line was found"),
        ("f,s\n\n", "a header but no row of numbers"),
        ("f,s\0\n1,2\n", "zero bytes, so it is binary"),
        (b"f,s \xb5V\n1,2\n", "byte 4 is not UTF-8 text"),
        ("f,s,s\n1,2,3\n", "two columns 's'"),
        ("f,s" + "s" * 200_000 + "\n1,2\n", "no header line was found"),
        (b"", "the file is empty"),
    ],
)
def test_damaged_scans(folder, write, text, match):
    write("scan_1.txt", f=[1, 2], s=[2, 3])
    path = folder / "scan_2.txt"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    with pytest.raises((UnreadableFile, MissingData), match=match) as caught:
        read_prcpy(folder, "scan", {})
    assert caught.value.file == str(path)


def test_names_that_disagree(folder, write):
    write("scan_1_5mT.txt", f=[1, 2], s=[2, 3])
    write("scan_2_6mA.txt", f=[1, 2], s=[2, 3])
    with pytest.raises(ConfigError, match=r"scan_1_5mT.txt is in mT, scan_2_6mA.txt in mA"):
        read_prcpy(folder, "scan", {})
    assert read_prcpy(folder, "scan", {}, input_from="none").input is None
    (folder / "scan_2_6mA.txt").rename(folder / "scan_2.txt")
    with pytest.raises(MissingData, match=r"scan_2.txt and 0 more names carry no input value"):
        read_prcpy(folder, "scan", {}, input_from="names")


def test_no_folder(folder, write):
    file = write("scan_1.txt", f=[1, 2], s=[2, 3])
    with pytest.raises(UnreadableFile, match="this is a file"):
        read_prcpy(file, "scan", {})
    with pytest.raises(UnreadableFile, match="the folder does not exist"):
        read_prcpy(folder / "no", "scan", {})


def test_times_that_do_not_increase(folder, write, run_import):
    for k in (1, 2):
        write(f"device_{k}.txt", t=[0.0, 0.1, 0.1, 0.2], Voltage=[1, 2, 3, 4])
    with pytest.raises(NonUniformTime, match=r"t goes from 0\.1 to 0\.1 after row 2"):
        run_import(folder, transpose=True)
    assert run_import(folder, transpose=True, interval=0.05).dt == 0.05


def test_an_interval_of_nothing(folder, scans, run_import):
    scans(3)
    with pytest.raises(ConfigError, match=r"interval is 0.0(.|\n)*above 0"):
        run_import(folder, xs="Frequency", readouts="Spectra", interval=0.0)
