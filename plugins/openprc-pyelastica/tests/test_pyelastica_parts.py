"""Recordings spread over numbered files."""

from __future__ import annotations

import numpy as np
from openprc_pyelastica.importer import Importer

from openprc.errors import IncompleteFile, SchemaError, UnreadableFile


def parts(folder, arrays, cuts, *, numbers=None, stem="run"):
    pieces = np.split(np.arange(len(arrays["time"])), cuts)
    numbers = numbers or range(len(pieces))
    for number, piece in zip(numbers, pieces, strict=True):
        chosen = {key: array[piece] for key, array in arrays.items()}
        np.savez(folder / f"{stem}_{number:02d}.npz", **chosen)


def test_parts_are_joined_in_numerical_order(tmp_path, wave, run_import, check):
    folder = tmp_path / "parts"
    folder.mkdir()
    parts(folder, wave(n_frames=220), list(range(2, 220, 2)))  # 00 .. 109
    assert Importer().sniff(folder) == 0.9
    check(run_import(folder), n_frames=220)
    check(run_import(folder / "run_100.npz"), n_frames=220)


def test_parts_as_pickles(tmp_path, wave, dump, run_import, check):
    arrays = wave()
    for number, piece in enumerate((slice(0, 25), slice(25, None))):
        dump({k: a[piece] for k, a in arrays.items()}, f"run_{number:02d}.pkl", as_lists=False)
    check(run_import(tmp_path / "run_00.pkl"))


def test_parts_of_two_rods_in_one_folder(tmp_path, wave, run_import):
    folder = tmp_path / "parts"
    folder.mkdir()
    parts(folder, wave(), [20], stem="left")
    parts(folder, wave(4, offset=5.0), [30], stem="right")
    run = run_import(folder)
    assert [run.node("label")[0], run.node("label")[-1]] == ["left:0", "right:3"]


def test_parts_that_repeat_samples(tmp_path, wave, run_import, check, notes):
    arrays = wave()
    for number, piece in enumerate((slice(0, 25), slice(22, None))):
        np.savez(tmp_path / f"run_{number:02d}.npz", **{k: a[piece] for k, a in arrays.items()})
    run = run_import(tmp_path / "run_01.npz")
    check(run)
    assert "run_01.npz repeats the last 3 samples" in notes(run)


def test_a_late_key_in_the_first_part(tmp_path, wave, run_import, extension):
    arrays = wave()
    late = np.arange(39.0)[:, np.newaxis] * np.ones(5)
    for number, (piece, own) in enumerate(
        ((slice(0, 25), slice(0, 24)), (slice(25, None), slice(24, None)))
    ):
        chosen = {k: a[piece] for k, a in arrays.items()}
        np.savez(tmp_path / f"run_{number:02d}.npz", **chosen, dilatation=late[own])
    values, _, comment = extension(run_import(tmp_path / "run_00.npz"), "rod0.dilatation")
    np.testing.assert_array_equal(values, late)
    assert "row 0 is frame 1" in comment


def test_a_missing_part_can_be_accepted(tmp_path, wave, run_import, notes):
    parts(tmp_path, wave(), [10, 20, 30])
    (tmp_path / "run_02.npz").unlink()
    run = run_import(tmp_path / "run_00.npz", gaps="keep")
    assert run.n_frames == 30
    assert "the parts run_02 are missing" in notes(run)


def test_numbering_that_starts_later_is_told(tmp_path, wave, run_import, check, notes):
    parts(tmp_path, wave(), [10], numbers=(4, 5))
    run = run_import(tmp_path / "run_04.npz")
    check(run)
    assert "starts at 4, not at 0" in notes(run)


def test_numbered_runs_are_not_parts(tmp_path, wave, run_import, check, notes):
    for number in (1, 2):
        np.savez(tmp_path / f"trial_{number:02d}.npz", **wave())
    run = run_import(tmp_path / "trial_02.npz")
    check(run)
    assert "runs of their own" in notes(run)


def cut(folder, arrays, *pieces, names=None):
    folder.mkdir(exist_ok=True)
    for number, piece in enumerate(pieces):
        name = names[number] if names else f"run_{number:02d}.npz"
        np.savez(folder / name, **{key: array[piece] for key, array in arrays.items()})
    return folder


def test_a_folder_without_parts(tmp_path, wave, refuses):
    np.savez(tmp_path / "a.npz", **wave())
    assert Importer().sniff(tmp_path) == 0.0
    refuses(tmp_path, UnreadableFile, "holds no parts")


def test_a_missing_part(tmp_path, wave, refuses):
    pieces = slice(0, 10), slice(10, 20), slice(20, 40)
    folder = cut(tmp_path / "parts", wave(), *pieces)
    (folder / "run_01.npz").unlink()
    error = refuses(folder, IncompleteFile, "the parts run_01 are missing")
    assert "gaps=keep" in error.fix


def test_a_pause_between_parts(tmp_path, wave, refuses):
    folder = cut(tmp_path / "parts", wave(), slice(0, 10), slice(15, 40))
    refuses(folder, IncompleteFile, r"run_01.npz begins 0\.3 s after the end")


def test_parts_that_overlap_and_disagree(tmp_path, wave, refuses):
    folder = cut(tmp_path / "parts", wave(), slice(0, 25))
    later = {key: array[20:].copy() for key, array in wave().items()}
    later["position"] += 1e-6
    np.savez(folder / "run_01.npz", **later)
    refuses(folder, SchemaError, "the two disagree there")


def test_parts_between_each_others_samples(tmp_path, wave, refuses):
    folder = cut(tmp_path / "parts", wave(), slice(0, 25))
    later = {key: array[20:].copy() for key, array in wave().items()}
    later["time"] += 0.013
    np.savez(folder / "run_01.npz", **later)
    refuses(folder, SchemaError, "the two disagree there")


def test_a_folder_of_runs(tmp_path, wave, refuses):
    folder = cut(tmp_path / "runs", wave(), slice(None), slice(None))
    refuses(folder, SchemaError, "not parts of one run")


def test_the_same_part_twice(tmp_path, wave, refuses):
    names = ["run_01.npz", "run_001.npz"]
    folder = cut(tmp_path / "parts", wave(), slice(0, 20), slice(20, 40), names=names)
    refuses(folder, UnreadableFile, "the same part twice")
    assert Importer().sniff(folder) == 0.0


def test_parts_of_different_rods(tmp_path, wave, refuses):
    folder = cut(tmp_path / "parts", wave(), slice(0, 20))
    np.savez(folder / "run_01.npz", **{k: a[20:] for k, a in wave(4).items()})
    refuses(folder, SchemaError, "does not continue shape")
