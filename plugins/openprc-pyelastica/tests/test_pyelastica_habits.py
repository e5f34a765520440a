"""Habits of saving that the shipped examples do not show: parts, rings, axes, odd keys."""

from __future__ import annotations

import pickle
import zipfile

import numpy as np
import pytest
from openprc_pyelastica.importer import Importer

from openprc.errors import ConfigError


def cut(arrays, start, stop):
    return {key: array[start:stop] for key, array in arrays.items()}


@pytest.mark.parametrize("suffix", ["npz", "pkl"])
def test_parts_without_samples_are_passed_over(tmp_path, wave, run_import, check, notes, suffix):
    """An export interval shorter than the pause between samples leaves empty files."""
    folder = tmp_path / "export"
    folder.mkdir()
    arrays = wave()
    for number, rows in enumerate([(0, 10), None, (10, 11), None, (11, 40), None]):
        path = folder / f"rod_{number:02d}.{suffix}"
        content = cut(arrays, *rows) if rows else {}
        if suffix == "pkl":
            path.write_bytes(pickle.dumps(content))
        else:
            np.savez(path, **content)
            assert bool(zipfile.ZipFile(path).namelist()) == bool(rows)
    for path in (folder, folder / f"rod_00.{suffix}"):
        run = run_import(path)
        check(run)
        assert "3 of 6 parts of rod hold no sample" in notes(run)


@pytest.mark.parametrize(("columns", "ring"), [(6, True), (4, False)])
def test_curvatures_alone_tell_a_ring(tmp_path, wave, run_import, columns, ring):
    """A ring of n nodes has n joints, an open rod n - 2."""
    np.savez(tmp_path / "a.npz", **wave(6), kappa=np.zeros((40, 3, columns)))
    bars = run_import(tmp_path / "a.npz").indices("bars").tolist()
    assert bars == [[i, i + 1] for i in range(5)] + ([[5, 0]] if ring else [])


@pytest.mark.parametrize("shape", [(40, 1), (1, 40)])
def test_times_in_a_column_or_a_row(tmp_path, wave, run_import, check, shape):
    arrays = wave()
    np.savez(tmp_path / "a.npz", **{**arrays, "time": arrays["time"].reshape(shape)})
    assert Importer().sniff(tmp_path / "a.npz") == 0.7
    check(run_import(tmp_path / "a.npz"))


@pytest.mark.parametrize("prefix", ["", "arm_"])
def test_three_arrays_of_coordinates(tmp_path, wave, run_import, check, prefix):
    arrays = wave()
    parts = {f"{prefix}{axis}": arrays["position"][:, i] for i, axis in enumerate("xyz")}
    np.savez(tmp_path / "a.npz", time=arrays["time"], **parts)
    assert Importer().sniff(tmp_path / "a.npz") >= 0.5
    check(run_import(tmp_path / "a.npz"), velocities=False)


def test_three_nodes_in_three_arrays_are_no_single_point(tmp_path, wave, run_import, check):
    arrays = wave(3)
    parts = {axis: arrays["position"][:, i] for i, axis in enumerate("xyz")}
    np.savez(tmp_path / "a.npz", time=arrays["time"], **parts)
    with pytest.raises(ConfigError, match="with three nodes the axes cannot be told apart"):
        run_import(tmp_path / "a.npz")
    check(run_import(tmp_path / "a.npz", axes="3n"), n_nodes=3, velocities=False)


@pytest.mark.parametrize("layout", ["3n", "n3"])
@pytest.mark.parametrize("name", ["directors", "tangents"])
def test_measured_tangents_beat_the_shape(tmp_path, wave, run_import, check, notes, name, layout):
    """Scripts that transpose the positions leave the directors as they are."""
    arrays = wave(3)
    arms = np.diff(arrays["position"], axis=2)
    tangents = arms / np.linalg.norm(arms, axis=1, keepdims=True)
    if name == "directors":
        aside = np.zeros_like(tangents)
        tangents = np.stack([aside, aside, tangents], axis=1)
    if layout == "n3":
        arrays = {k: a.swapaxes(1, 2) if a.ndim == 3 else a for k, a in arrays.items()}
    np.savez(tmp_path / "a.npz", **arrays, **{name: tangents})
    run = run_import(tmp_path / "a.npz")
    check(run, n_nodes=3)
    assert f"axes {layout} concluded from tangents" in notes(run)


def test_contacts_that_come_and_go_are_left_out(dump, wave, run_import, check, notes):
    content = {key: list(array) for key, array in wave().items()}
    content["contacts"] = [[1] * (row % 3) for row in range(40)]
    content["loads"] = [np.zeros(row % 2) for row in range(40)]
    run = run_import(dump(content, as_lists=False))
    check(run)
    assert "contacts, loads hold no numbers of one shape and were left out" in notes(run)


@pytest.mark.parametrize(
    ("keys", "turned", "score"),
    [
        (("time", "position"), False, 0.7),
        (("time", "position"), True, 0.55),
        (("t", "X"), False, 0.55),
        (("t", "X"), True, 0.4),
    ],
)
def test_shapes_inside_a_pickle_break_ties(tmp_path, wave, keys, turned, score):
    """Components first is PyElastica's habit; the words are those of other programs too."""
    arrays = wave()
    positions = arrays["position"].swapaxes(1, 2) if turned else arrays["position"]
    samples = [dict(zip(keys, pair, strict=True)) for pair in zip(arrays["time"].tolist(),
               positions, strict=True)]  # fmt: skip
    path = tmp_path / "run.pkl"
    path.write_bytes(pickle.dumps(samples))
    assert Importer().sniff(path) == score


def test_three_nodes_of_either_program_are_asked_about(tmp_path, wave):
    arrays = wave(3)
    np.savez(tmp_path / "a.npz", time=arrays["time"], position=arrays["position"])
    assert Importer().sniff(tmp_path / "a.npz") == 0.55
