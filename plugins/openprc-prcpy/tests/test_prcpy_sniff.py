"""Which folders are taken for PRCpy experiments, and which are left to others."""

from __future__ import annotations

import numpy as np
import pytest
from openprc_prcpy import samples
from openprc_prcpy.importer import Importer

F = np.linspace(1.0, 2.0, 30)
sniff = Importer().sniff


def test_the_sample(tmp_path):
    assert sniff(samples.write_sample(tmp_path).path) == 0.8


def test_scans_without_values_and_devices(folder, scans, write):
    scans(5, values=False)
    assert sniff(folder) == 0.7
    for path in folder.iterdir():
        path.unlink()
    for k in range(4):
        write(f"device_{k + 1}.txt", delimiter="\t", t=F, Voltage=np.sin(F + k))
    assert sniff(folder) == 0.7


def test_long_scans_are_judged_by_their_beginning(folder, write):
    for k in range(3):
        f = np.arange(30_000) * 1e-3
        write(f"scan_{k + 1}.txt", Frequency=f, Spectra=np.sin(f + k))
    assert (folder / "scan_1.txt").stat().st_size > 1 << 17
    assert sniff(folder) == 0.7


@pytest.mark.parametrize(
    "columns",
    [
        lambda k: {"x": F + k, "y": F, "z": F},
        lambda k: {"node": F, "ux": F * k},
        lambda k: {"x0": F, "y0": F * k},
        lambda k: {"Frequency": F, "Spectra": F},  # the same file again and again
        lambda k: {"Frequency": F + k, "Spectra": F * k},  # nothing in common
        lambda k: {"Frequency": 0 * F, "Spectra": F * k},  # no axis
        lambda k: {f"Frequency{k}": F, "Spectra": F * k},
        lambda k: {"Frequency": F[: 20 + k], "Spectra": F[: 20 + k]},
        lambda k: {"Spectra": F * k},
    ],
)
def test_tables_of_something_else(folder, write, columns):
    for k in range(4):
        write(f"frame_{k}.csv", **columns(k))
    assert sniff(folder) == 0.3


@pytest.mark.parametrize(
    "content",
    [b"", b"\0" * 100, b"PK\x03\x04" + b"scan" * 50, b"1,2\n3,4\n", b"a,b\n1\n", b"a,b\n1,x\n2,y\n",
     b'a,b\n"1,2\n', bytes(np.random.default_rng(0).integers(0, 256, 5000, dtype="u1"))],
)  # fmt: skip
def test_decoys_with_the_right_names(folder, content):
    for k in range(4):
        (folder / f"scan_{k}.txt").write_bytes(content)
    assert sniff(folder) == 0.3


@pytest.mark.parametrize(
    "names",
    [
        [],
        ["scan_1.txt", "scan_2.txt"],
        ["frame_1.obj", "frame_2.obj", "frame_3.obj"],
        ["export_00.npz", "export_01.npz", "export_02.npz"],
        ["a.txt", "b.txt", "c.txt"],
        ["img_1.png", "img_2.png", "img_3.png"],
    ],
)
def test_other_folders(folder, names):
    for name in names:
        (folder / name).write_text("f,s\n1,2\n2,3\n")
    assert sniff(folder) == 0.0


def test_paths_that_are_no_folder(folder, write):
    assert sniff(write("scan_1.txt", f=F, s=F)) == 0.0
    assert sniff(folder / "none") == 0.0


def test_other_importers_leave_the_sample_alone(tmp_path):
    from openprc.hooks import default_registry
    from openprc.hooks.sniff import choose_importer

    registry = default_registry()
    if "prcpy" not in {item.name for item in registry.producers}:
        pytest.skip("the plugin is not installed")
    choice = choose_importer(samples.write_sample(tmp_path).path, registry=registry)
    assert choice.item.name == "prcpy"
    assert max((v.score for v in choice.verdicts if v.item.name != "prcpy"), default=0.0) < 0.5
