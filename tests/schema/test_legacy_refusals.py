"""What is not an old trajectory, or is damaged."""

from __future__ import annotations

import h5py
import numpy as np
import pytest
from older_files import convert, motion, write_inputs, write_run

from openprc.errors import (
    NotATrajectory,
    OpenPRCError,
    UnreadableFile,
    UnsafeFile,
)
from openprc.schema.legacy import LegacyImporter


@pytest.fixture
def experiment(tmp_path):
    folder = tmp_path / "experiment"
    write_inputs(folder / "input")
    write_run(folder / "output/simulation.h5", motion())
    return folder


# --- what is not an old trajectory ---


def write_features(file):
    file["vision/feature_map/keypoints"] = np.zeros((5, 2), "f4")


def write_cache(file):
    file.attrs.update({"content_hash": "ab", "video_path": "a.mp4"})


def write_equilibria(file):
    file["equilibria/eq_000/positions"] = np.zeros((4, 3))


def write_narma(file):
    file["NARMA/narma2_nrmse"] = 0.4


@pytest.mark.parametrize(
    ("write", "words"),
    [
        (write_features, "points detected in one image"),
        (write_cache, "points detected in one image"),
        (write_equilibria, "a list of equilibria"),
        (write_narma, "benchmark results"),
    ],
)
def test_other_files_are_refused_by_name(tmp_path, write, words):
    path = tmp_path / "file.h5"
    with h5py.File(path, "w") as file:
        write(file)
    assert LegacyImporter().sniff(path) >= 0.5
    with pytest.raises(NotATrajectory, match=words):
        convert(path, tmp_path / "run.h5")


@pytest.mark.parametrize("trained", [True, False])
def test_weights_alone_are_no_readout(tmp_path, trained):
    """Networks of other programs keep `model/weights` as well."""
    path = tmp_path / "weights.h5"
    with h5py.File(path, "w") as file:
        file["model/weights"] = np.zeros(5)
        if trained:
            file["preprocessing/X_mean"] = np.zeros(4)
    assert LegacyImporter().sniff(path) == (0.7 if trained else 0.0)
    words = "a trained readout" if trained else "none of the layouts"
    with pytest.raises((NotATrajectory, UnreadableFile), match=words):
        convert(path, tmp_path / "run.h5")


def test_files_of_the_present_contract_are_not_claimed(experiment, tmp_path):
    out = tmp_path / "run.h5"
    convert(experiment, out).close()
    assert LegacyImporter().sniff(out) == 0.0
    out.replace(experiment / "output/simulation.h5")
    assert LegacyImporter().sniff(experiment) == 0.0
    with pytest.raises(UnreadableFile, match="none of the layouts"):
        convert(experiment, out)


def make_decoy(kind, path):
    if kind == "empty":
        path.write_bytes(b"")
    elif kind == "noise":
        path.write_bytes(np.random.default_rng(0).bytes(4096))
    elif kind == "text":
        path.write_text("time,x,y\n0,1,2\n")
    elif kind == "truncated":
        write_run(path, motion())
        path.write_bytes(path.read_bytes()[:3000])
    elif kind == "foreign":
        with h5py.File(path, "w") as file:
            file["particles/all/position/value"] = np.zeros((3, 4, 3))
    elif kind == "folder":
        path.mkdir()


@pytest.mark.parametrize("kind", ["empty", "noise", "text", "truncated", "foreign", "folder"])
def test_decoys_are_not_claimed_and_refused(kind, tmp_path):
    path = tmp_path / "simulation.h5"
    make_decoy(kind, path)
    assert LegacyImporter().sniff(path) < 0.5
    with pytest.raises(UnreadableFile):
        convert(path, tmp_path / "run.h5")
    assert not (tmp_path / "run.h5").exists()


def test_missing_path(tmp_path):
    assert LegacyImporter().sniff(tmp_path / "nothing") == 0.0
    with pytest.raises(UnreadableFile, match="does not exist"):
        convert(tmp_path / "nothing", tmp_path / "run.h5")


def test_external_link_is_refused(tmp_path):
    path = write_run(tmp_path / "a.h5", motion())
    with h5py.File(path, "r+") as file:
        file["elsewhere"] = h5py.ExternalLink("b.h5", "/secret")
    assert LegacyImporter().sniff(path) == 0.0
    with pytest.raises(UnsafeFile, match="external link"):
        convert(path, tmp_path / "run.h5")


@pytest.mark.parametrize("seed", range(20))
def test_flipped_bytes_end_in_a_named_error_or_a_file(seed, tmp_path):
    path = write_run(tmp_path / "a.h5", motion(), stored_drive=True)
    raw = bytearray(path.read_bytes())
    rng = np.random.default_rng(seed)
    for place in rng.integers(0, len(raw), 20):
        raw[place] ^= 1 << int(rng.integers(8))
    path.write_bytes(raw)
    out = tmp_path / "run.h5"
    try:
        convert(path, out).close()
    except OpenPRCError:
        assert not out.exists()
    else:
        assert out.exists()
