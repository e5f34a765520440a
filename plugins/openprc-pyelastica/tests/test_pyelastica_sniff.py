"""What is taken for a PyElastica recording, and what is left to others."""

from __future__ import annotations

import pickle
import subprocess
import sys
import time

import numpy as np
import pytest
from openprc_pyelastica.importer import Importer

T = np.arange(40) * 0.1


def arrays(**shapes):
    return {key: np.zeros((40, *shape)) for key, shape in shapes.items()}


@pytest.mark.parametrize(
    ("content", "low", "high"),
    [
        # as PyElastica and its ExportCallBack leave them
        ({"time": T, **arrays(position=(3, 20))}, 0.7, 0.7),
        ({"time": T, "step": T, **arrays(position=(3, 20), velocity=(3, 20))}, 0.7, 0.7),
        ({"time": T, **arrays(position=(3, 20), directors=(3, 3, 19))}, 0.8, 0.9),
        ({"time": T, **arrays(position_collection=(3, 20))}, 0.8, 0.9),
        ({"a_time": T, **arrays(a_position=(3, 20), a_sigma=(3, 19))}, 0.8, 0.9),
        ({"t": T, **arrays(position=(20, 3), kappa=(18, 3))}, 0.5, 0.8),
        ({"time": T, **arrays(position=(3, 3), directors=(3, 3, 2))}, 0.5, 0.9),
        # what other programs' users save
        ({"t": T, **arrays(positions=(20, 3))}, 0.0, 0.49),
        ({"time": T, **arrays(position=(20, 3), velocity=(20, 3))}, 0.0, 0.49),
        ({"t": T, **arrays(positions=(3, 3))}, 0.0, 0.49),
        ({"t": T, **arrays(position=(3,))}, 0.0, 0.49),
        ({"time": T, **arrays(position=(20, 2))}, 0.0, 0.49),
        ({"time": T[:7], **arrays(position=(3, 20))}, 0.0, 0.49),
        (arrays(position=(3, 20)), 0.0, 0.49),
        ({"a": T, "b": T}, 0.0, 0.0),
    ],
)
def test_archives(tmp_path, content, low, high):
    np.savez(tmp_path / "a.npz", **content)
    assert low <= Importer().sniff(tmp_path / "a.npz") <= high


def test_components_first_beat_nodes_first(tmp_path):
    np.savez(tmp_path / "own.npz", time=T, **arrays(position=(3, 20)))
    np.savez(tmp_path / "other.npz", time=T, **arrays(position=(20, 3)))
    sniff = Importer().sniff
    assert sniff(tmp_path / "own.npz") >= 0.5 > sniff(tmp_path / "other.npz")


@pytest.mark.parametrize(
    ("keys", "as_lists", "low", "high"),
    [
        (("time", "position"), True, 0.7, 0.7),
        (("time", "position", "sigma"), False, 0.8, 0.9),
        (("time", "position"), False, 0.5, 0.7),
        (("t", "positions"), False, 0.55, 0.55),  # components first
        (("time", "torque"), True, 0.0, 0.0),
    ],
)
def test_pickles(dump, keys, as_lists, low, high):
    path = dump({key: np.zeros((4, 3, 5)) for key in keys}, as_lists=as_lists)
    assert low <= Importer().sniff(path) <= high


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\x00",
        b"PK\x03\x04",
        b"PK\x03\x04" + b"time.npy position.npy" * 50,
        b"\x80\x04",
        b"\x80\x04\x95" + b"\xff" * 300,
        b"time,position\n0,1\n",
        b"\x89HDF\r\n\x1a\n" + b"\x00" * 200,
        bytes(np.random.default_rng(0).integers(0, 256, 5000, dtype="u1")),
    ],
)
@pytest.mark.parametrize("suffix", [".npz", ".dat", ".pkl"])
def test_decoys(tmp_path, content, suffix):
    path = tmp_path / f"decoy{suffix}"
    path.write_bytes(content)
    assert Importer().sniff(path) < 0.5


def test_paths_that_are_not_there(tmp_path):
    assert Importer().sniff(tmp_path / "none.npz") == 0.0
    assert Importer().sniff(tmp_path) == 0.0


def test_sniffing_runs_no_code(tmp_path):
    witness = tmp_path / "witness"
    text = f"cbuiltins\nopen\n(V{witness}\nVw\ntR."
    (tmp_path / "a.dat").write_text(text)
    assert Importer().sniff(tmp_path / "a.dat") < 0.5
    assert not witness.exists()


def test_a_long_pickle_is_judged_by_its_beginning(tmp_path):
    path = tmp_path / "a.pkl"
    with path.open("wb") as stream:
        pickle.dump({"time": T, "position": np.zeros((4000, 3, 50)), "sigma": T}, stream)
    started = time.perf_counter()
    assert Importer().sniff(path) >= 0.5
    assert time.perf_counter() - started < 1.0


def test_the_entry_module_is_light():
    code = (
        "import sys, openprc_pyelastica; openprc_pyelastica.openprc_producers(); "
        "heavy = {'numpy', 'elastica', 'numba', 'scipy', 'h5py'} & set(sys.modules); "
        "sys.exit(', '.join(heavy) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_importing_needs_no_simulator():
    code = "import sys, openprc_pyelastica.importer; sys.exit('elastica' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0
