"""Everything that is not a usable recording is refused in words, and nothing is written."""

from __future__ import annotations

import os
import pickle
import zipfile

import numpy as np
import pytest
from openprc_pyelastica.importer import Importer

from openprc.errors import (
    ConfigError,
    Diverged,
    MissingData,
    NotATrajectory,
    SchemaError,
    UnitError,
    UnreadableFile,
    UnsafeFile,
)


@pytest.fixture
def save(tmp_path):
    def write(name="a.npz", **arrays):
        np.savez(tmp_path / name, **arrays)
        return tmp_path / name

    return write


def without(arrays, *keys):
    return {key: array for key, array in arrays.items() if key not in keys}


# --- what holds no trajectory -----------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "kind", "match"),
    [
        ({"position": np.arange(40.0)}, NotATrajectory, "one number a sample"),
        ({"position": np.zeros((40, 4, 5))}, SchemaError, "no axis after the first has length 3"),
        ({"position": np.zeros((40, 5))}, MissingData, "no node positions among"),
        ({"position": np.zeros((20, 3, 6))}, SchemaError, "20 samples of positions and 40 times"),
        ({"position": np.zeros((0, 3, 6))}, MissingData, "no samples were stored"),
        ({"velocity": np.zeros((40, 3, 6)), "position": None}, MissingData, "no node positions"),
        ({"time": None}, MissingData, "no time axis goes with position"),
        ({"time": np.full(40, np.nan)}, SchemaError, "time is not finite at sample 0"),
        ({"time": np.r_[0:20, 0:20] * 1.0}, SchemaError, "time runs backwards after sample 19"),
    ],
)
def test_arrays_that_do_not_fit(save, wave, refuses, change, kind, match):
    arrays = {key: array for key, array in (wave() | change).items() if array is not None}
    refuses(save(**arrays), kind, match)


def test_three_nodes_without_a_hint(save, wave, refuses):
    error = refuses(save(**wave(3)), ConfigError, "three nodes the axes cannot be told apart")
    assert "axes=3n" in error.fix


def test_three_nodes_with_hints_that_contradict_each_other(save, wave, refuses):
    path = save(**wave(3), sigma=np.zeros((40, 3, 2)), tangents=np.zeros((40, 2, 3)))
    refuses(path, ConfigError, "sigma, tangents contradict each other")


def test_axes_that_do_not_fit(save, wave, refuses):
    refuses(save(**wave()), SchemaError, r"axes=n3 does not fit .*\(40, 3, 6\)", axes="n3")


def test_a_rod_that_changes_its_number_of_nodes(dump, wave, refuses):
    arrays = wave()
    grown = [*arrays["position"][:30], *np.zeros((10, 3, 7))]
    path = dump({**arrays, "position": grown})
    refuses(path, SchemaError, r"sample 30 has shape \(3, 7\), sample 0 has \(3, 6\)")


def test_rods_on_two_clocks(save, wave, refuses):
    arrays = {f"a_{k}": v for k, v in wave().items()}
    arrays |= {f"b_{k}": v for k, v in wave(n_frames=30).items()}
    error = refuses(save(**arrays), SchemaError, "rod b has 30 samples")
    assert "rods=a, then rods=b" in error.fix


def test_the_state_of_one_instant(save, refuses):
    path = save(
        position_collection=np.zeros((3, 6)),
        rest_lengths=np.ones(5),
        shear_matrix=np.zeros((3, 3, 5)),
        bend_matrix=np.zeros((3, 3, 4)),
    )
    assert Importer().sniff(path) >= 0.5
    refuses(path, NotATrajectory, "saved state of one rod")


def test_one_instant_with_its_time(save, refuses):
    path = save(time=np.array([1.0]), position=np.zeros((3, 3)))
    refuses(path, NotATrajectory, "one instant")


# --- files that are broken, foreign or dangerous ----------------------------------------------


def test_missing_empty_and_foreign_files(tmp_path, refuses):
    refuses(tmp_path / "none.npz", UnreadableFile, "does not exist")
    (tmp_path / "empty.npz").touch()
    refuses(tmp_path / "empty.npz", UnreadableFile, "empty")
    (tmp_path / "text.dat").write_text("time position\n0 1\n")
    refuses(tmp_path / "text.dat", UnreadableFile, "neither an archive of arrays")


@pytest.mark.parametrize("share", [0.2, 0.6, 0.95])
def test_truncated_files(tmp_path, save, dump, wave, refuses, share):
    for path in (save(**wave()), dump(wave())):
        content = path.read_bytes()
        path.write_bytes(content[: int(len(content) * share)])
        # A pickle that was cut off is claimed, so that the user hears what is wrong with it.
        assert Importer().sniff(path) == (0.55 if path.suffix == ".dat" else 0.0)
        refuses(path, UnreadableFile, "archive|pickle")


def test_a_damaged_compressed_archive(tmp_path, wave, refuses):
    path = tmp_path / "a.npz"
    np.savez_compressed(path, **wave())
    content = bytearray(path.read_bytes())
    with zipfile.ZipFile(path) as archive:
        start = archive.getinfo("position.npy").header_offset + 400
    content[start : start + 200] = bytes(200)
    path.write_bytes(bytes(content))
    Importer().sniff(path)
    refuses(path, UnreadableFile, "archive|array|damaged")


def test_python_objects_in_an_archive(save, wave, refuses):
    path = save(**wave(), extra=np.array([{"a": 1}], dtype=object))
    refuses(path, UnsafeFile, "Python objects")


class Bomb:
    def __reduce__(self):
        return os.getcwd, ()


def test_a_pickle_that_runs_code(dump, wave, refuses):
    path = dump({**wave(), "extra": Bomb()}, as_lists=False)
    refuses(path, UnsafeFile, "getcwd")


def test_pickles_dumped_one_after_the_other(tmp_path, wave, refuses):
    path = tmp_path / "a.dat"
    with path.open("wb") as stream:
        pickle.dump(wave(), stream)
        pickle.dump(wave(), stream)
    refuses(path, SchemaError, "several were dumped one after the other")


@pytest.mark.parametrize("content", [3.0, "text", [1.0, 2.0], [np.zeros(3)], None])
def test_pickles_of_other_things(dump, refuses, content):
    path = dump(content, as_lists=False)
    assert Importer().sniff(path) < 0.5
    refuses(path, UnreadableFile, "it holds a|neither an archive")


def test_samples_with_different_keys(dump, refuses):
    path = dump([{"time": 0.0, "position": np.zeros((3, 4))}, {"time": 1.0}], as_lists=False)
    refuses(path, SchemaError, "sample 1 has the keys")


def test_dicts_without_end(dump, wave, refuses):
    nest = wave()
    for _ in range(12):
        nest = {"a": nest}
    refuses(dump(nest, as_lists=False), UnreadableFile, "nested deeper than 8")


# --- options that do not fit -------------------------------------------------------------------


@pytest.mark.parametrize(
    ("options", "kind", "match"),
    [
        ({"rods": ("arm",)}, ConfigError, "no rod is called arm"),
        ({"dt": 0.1}, ConfigError, "dt is 0.1, and the file has its own times, 0.05 s apart"),
        ({"position": "shape"}, MissingData, "there is no key 'shape'"),
        ({"time": "clock"}, MissingData, "there is no key 'clock'"),
        ({"input": "force"}, MissingData, "there is no key 'force'"),
        ({"input": "position"}, ConfigError, r"position has shape \(40, 3, 6\)"),
        ({"input": "few"}, SchemaError, "13 samples, and 40 times"),
        ({"input": "nan"}, ConfigError, "not finite"),
        ({"input": "few2"}, SchemaError, "39 samples, and 40 times"),
        ({"input": "energy", "input_unit": "furlong"}, UnitError, "furlong"),
        ({"plane": "xy"}, ConfigError, "not in the plane xy: positions spread over .* along z"),
        ({"channels": ("tension",)}, ConfigError, "tension: not stored"),
        ({"channels": ("dilatation",)}, ConfigError, "no value at the first frame"),
    ],
)
def test_options(save, wave, refuses, options, kind, match):
    path = save(
        **wave(),
        energy=np.ones(40),
        few=np.ones(13),
        few2=np.ones(39),
        nan=np.full(40, np.nan),
        dilatation=np.ones((39, 5)),
    )
    refuses(path, kind, match, **options)


@pytest.mark.parametrize("dt", [0.0, -1.0, float("nan")])
def test_a_dt_that_is_none(save, wave, refuses, dt):
    refuses(save(**without(wave(), "time")), ConfigError, "dt is", dt=dt)


def test_dt_with_uneven_steps(save, wave, refuses):
    path = save(**without(wave(), "time"), step=np.arange(40) ** 2)
    refuses(path, ConfigError, "not evenly spaced", dt=0.1)


def test_two_candidates_for_the_drive(save, wave, refuses):
    path = save(**wave(), u=np.ones(40), forcing=np.ones(40))
    refuses(path, ConfigError, "forcing, u may each be the drive")


# --- divergence ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("factor", "reason"),
    [
        (12.0, "an element"),
        (float("nan"), "numbers that are not finite"),
        (float("inf"), "numbers that are not finite"),
        (1e200, "an element"),
    ],
)
def test_divergence(save, wave, refuses, run_import, factor, reason):
    arrays = wave()
    arrays["position"][31:, :, 1:] *= factor
    path = save(**arrays)
    refuses(path, Diverged, f"(?s)frame 31, t = 1.55 s: {reason}")
    assert run_import(path, diverged="trim").n_frames == 31


def test_numbers_that_are_not_finite_cannot_be_kept(save, wave, refuses):
    arrays = wave()
    arrays["velocity"][20, 0, 3] = np.nan
    error = refuses(save(**arrays), Diverged, "frame 20", diverged="keep")
    assert "diverged=keep" not in error.fix


def test_nothing_to_cut_off(save, wave, refuses):
    arrays = wave()
    arrays["position"][0, 0, 0] = np.nan
    error = refuses(save(**arrays), Diverged, "frame 0", diverged="trim")
    assert "trim" not in error.fix


def test_a_body_that_leaves_at_once(save, wave, refuses):
    arrays = wave()
    arrays["position"][33:] += 1e5  # no element changes its length
    refuses(save(**arrays), Diverged, "frame 33.*a node .* times faster")


def test_strong_motion_is_not_divergence(save, wave, run_import):
    arrays = without(wave(n_frames=400), "velocity")
    arrays["position"] *= 1.0 + 8.0 * np.sin(arrays["time"])[:, np.newaxis, np.newaxis] ** 2
    arrays["position"][:, 2] -= 4.9 * arrays["time"][:, np.newaxis] ** 2  # falls 2 km in 20 s
    assert run_import(save(**arrays)).n_frames == 400
