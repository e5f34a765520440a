"""Which files are scans, in which order, and what their names say."""

from __future__ import annotations

import pytest
from openprc_prcpy.file_names import find_prefix, natural_key, parse_name, scan_numbers, select

from openprc.errors import ConfigError, MissingData, UnreadableFile


@pytest.mark.parametrize(
    ("name", "index", "value", "unit", "rest"),
    [
        ("scan_1_62_923mT.txt", 1, 62.923, "mT", ""),
        ("scan_100_-12_53mA_0_to_-140mT.txt", 100, -12.53, "mA", "_0_to_-140mT"),
        ("scan_20_145_36mT.txt", 20, 145.36, "mT", ""),
        ("scan_7_-0_05V.csv", 7, -0.05, "V", ""),
        ("scan_3_170mT.txt", 3, 170.0, "mT", ""),
        ("scan_4_62.923mT.txt", 4, 62.923, "mT", ""),
        ("scan_4_62.923mT", 4, 62.923, "mT", ""),
        ("scan_5_+0_5.txt", 5, 0.5, None, ""),
        ("scan_6_100Ohm.txt", 6, 100.0, "ohm", ""),
        ("scan_17.txt", 17, None, None, ""),
        ("scan17", 17, None, None, ""),
        ("scan-009.dat", 9, None, None, ""),
        ("scan_7_2024_01_15.txt", 7, None, None, "_2024_01_15"),
        ("scan_8_run2.txt", 8, None, None, "_run2"),
        ("scan_bg.txt", None, None, None, "_bg"),
    ],
)
def test_a_name_says_number_value_and_unit(name, index, value, unit, rest):
    found = parse_name(name, "scan")
    assert (found.index, found.value, found.unit, found.rest) == (index, value, unit, rest)


def test_natural_order():
    names = ["b2", "scan_10", "scan_9", "10", "9", "Scan_1", "scan"]
    assert sorted(names, key=natural_key) == [
        "9", "10", "b2", "scan", "Scan_1", "scan_9", "scan_10",
    ]  # fmt: skip


def make(folder, *names):
    for name in names:
        (folder / name).write_text("x\n")


def test_a_file_belongs_when_its_name_begins_with_the_prefix(folder):
    make(folder, "scan_2.txt", "scan_10.txt", "scan-1.txt", "old_scan_3.txt", "scan_bg.txt",
         "scan_BG_4K.txt", "scan_notes.txt", "scanner_4.txt", "BG.txt", "metadata.txt",
         ".scan_5.txt", "scan_6_background.txt", "scan_dark_7.txt")  # fmt: skip
    (folder / "scan_9.txt").mkdir()
    chosen = select(folder, "scan", background="scan_dark_7.txt", transpose=False)
    assert [item.name for item in chosen.files] == ["scan-1.txt", "scan_2.txt", "scan_10.txt"]
    assert dict(chosen.left_out) == {
        "BG.txt": "another name",
        "metadata.txt": "another name",
        "old_scan_3.txt": "contains the prefix, does not begin with it",
        "scan_bg.txt": "a background by its name",
        "scan_BG_4K.txt": "a background by its name",
        "scan_6_background.txt": "a background by its name",
        "scan_notes.txt": "no number after the prefix",
        "scanner_4.txt": "no number after the prefix",
        "scan_dark_7.txt": "the background",
    }
    assert "old_scan_3.txt (contains the prefix" in chosen.remark()
    assert chosen.remark().endswith("and 1 more")


def test_devices_need_no_number(folder):
    make(folder, "dev_b.txt", "dev_a.txt", "dev_10.txt", "dev_9.txt", "notes.txt")
    chosen = select(folder, "dev", background=None, transpose=True)
    assert [i.name for i in chosen.files] == ["dev_9.txt", "dev_10.txt", "dev_a.txt", "dev_b.txt"]


def test_scans_are_sorted_by_number_whatever_separates_it(folder):
    make(folder, "scan_1.txt", "scan-2.txt", "scan 3.txt", "scan4.txt")
    chosen = select(folder, "scan", background=None, transpose=False)
    assert [item.index for item in chosen.files] == [1, 2, 3, 4]


def test_two_files_of_one_number(folder):
    make(folder, "scan_1_5mT.txt", "scan_01_6mT.txt", "scan_2_7mT.txt")
    with pytest.raises(UnreadableFile, match=r"scan_01_6mT.txt are both scan 1|scan_1_5mT.txt are"):
        select(folder, "scan", background=None, transpose=False)


def test_nothing_begins_with_the_prefix(folder):
    make(folder, "old_scan_1.txt")
    with pytest.raises(MissingData, match=r"no scan begins with 'scan'; .*old_scan_1.txt \(contai"):
        select(folder, "scan", background=None, transpose=False)
    with pytest.raises(ConfigError, match="the prefix is empty"):
        select(folder, "", background=None, transpose=False)


def test_missing_numbers_are_refused_or_closed(folder):
    make(folder, "scan_4.txt", "scan_5.txt", "scan_8.txt", "scan_9.txt", "scan_12.txt")
    files = select(folder, "scan", background=None, transpose=False).files
    with pytest.raises(UnreadableFile, match="4 of the scans 4 to 12 are missing; the first is 6"):
        scan_numbers(files, gaps="error", folder=folder)
    assert scan_numbers(files, gaps="close", folder=folder).tolist() == [1, 2, 3, 4, 5]
    assert scan_numbers(files[:2], gaps="close", folder=folder).tolist() == [4, 5]


def test_numbers_that_are_dates_take_no_memory(folder):
    make(folder, "scan_1.txt", "scan_20240115123456789.txt")
    files = select(folder, "scan", background=None, transpose=False).files
    with pytest.raises(UnreadableFile, match="are missing; the first is 2"):
        scan_numbers(files, gaps="error", folder=folder)


def test_the_prefix_is_found_when_one_stands_out(folder):
    names = ["scan_1.txt", "scan_2.txt", "old_1.txt", "BG_450mT.txt", "BG_4K.txt", "notes.txt"]
    assert find_prefix(names, folder=folder) == "scan"
    with pytest.raises(ConfigError, match=r"dev \(2 files\), scan \(2 files\)"):
        find_prefix([*names, "dev_1.txt", "dev_2.txt"], folder=folder)
    with pytest.raises(ConfigError, match="beginnings of numbered file names: none"):
        find_prefix(["notes.txt"], folder=folder)
