"""Commands on files of the package: info, validate, repair, pack, migrate, benchmark."""

from __future__ import annotations

import shutil

import h5py
import numpy as np
import pytest

from openprc.schema import Provenance, Trajectory, TrajectoryWriter, validate_file
from openprc.schema.results import write_result


def edit(path, change):
    with h5py.File(path, "r+") as file:
        change(file)
    return path


# --- info --------------------------------------------------------------------------------------


def test_info_on_a_trajectory(openprc, make_file):
    path = make_file(inputs=True)
    data = openprc("info", path, "--json").data
    assert (data["kind"], data["status"], data["n_frames"], data["n_nodes"], data["dims"]) == (
        "trajectory", "complete", 40, 4, 3,
    )  # fmt: skip
    assert data["time"]["uniform"] is True
    assert data["time"]["dt"] == pytest.approx(0.1)
    assert data["channels"] == {"gauge": ["left [mm]", "right [mm]"]}
    assert data["elements"]["bars"]["count"] == 3
    assert data["inputs"]["drive"]["symbols"] == 40
    assert data["positions"]["unit"] == "m"
    assert data["provenance"]["producer"] == "test"
    outcome = openprc("info", path)
    assert outcome.code == 0
    for words in ("n_frames", "40", "inputs.drive.unit", "provenance.producer"):
        assert words in outcome.text


def test_brackets_in_a_file_are_shown_as_they_are(openprc, make_file):
    # "[mm]" looks like a style to the library that draws the tables.
    assert "left [mm], right [mm]" in openprc("info", make_file()).text


def test_markup_in_names_is_harmless(openprc, tmp_path):
    path = tmp_path / "odd.h5"
    with TrajectoryWriter(path, provenance=Provenance("[/bold]"), title="[red]:smile:") as writer:
        writer.declare_channel("c", ["[/]", "[bold]x"], unit="mm")
        writer.append([0.0, 1.0], channels={"c": np.eye(2)})
    outcome = openprc("info", path)
    assert outcome.code == 0
    assert "[/], [bold]x" in outcome.text
    edit(path, lambda file: file.create_dataset("time_series/channels/[/red]", data=1.0))
    outcome = openprc("validate", path)
    assert outcome.code == 0
    assert "OPS-L02 /time_series/channels/[/red]:" in outcome.text


def test_a_file_cannot_command_the_terminal(openprc, make_file):
    path = edit(make_file(), lambda file: file.attrs.update(created="2026\x1b[2J\x07"))
    for command in ("info", "validate"):
        outcome = openprc(command, path)
        assert "\x1b" not in outcome.out
        assert "2026" in outcome.out


def test_info_on_an_unfinished_run(openprc, partial_file):
    data = openprc("info", partial_file, "--json").data
    assert (data["status"], data["n_frames"]) == ("failed", 7)


def test_info_on_an_experiment(openprc, experiment_folder):
    for path in (experiment_folder, experiment_folder / "input"):
        data = openprc("info", path, "--json").data
        assert (data["kind"], data["n_nodes"], data["n_bars"]) == ("experiment", 2, 1)
        assert data["actuators"] == ["position u on node 0"]
    assert "position u on node 0" in openprc("info", experiment_folder).text


@pytest.mark.parametrize("kind", ["readout", "metrics", "optimization"])
def test_info_on_results(openprc, tmp_path, kind):
    path = write_result(
        tmp_path / f"{kind}.h5",
        kind=kind,
        attrs={"narma2/order": 2},
        arrays={"model/weights": np.zeros((3, 1))},
        provenance=Provenance("test"),
    )
    data = openprc("info", path, "--json").data
    assert (data["kind"], data["arrays"]) == (kind, {"model/weights": [3, 1]})
    assert data["attributes"]["narma2/order"] == 2
    assert "arrays.model/weights" in openprc("info", path).text


def test_info_on_foreign_hdf5(openprc, tmp_path):
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["positions"] = np.zeros((3, 2))
    outcome = openprc("info", "other.h5")
    assert outcome.code == 0
    assert "openprc import" in outcome.text
    assert "datasets.positions" in outcome.text


# --- validate ----------------------------------------------------------------------------------


def test_validate_a_valid_file(openprc, make_file):
    path = make_file(inputs=True)
    outcome = openprc("validate", path)
    assert outcome.code == 0
    assert f"{path.name}: valid" in "".join(outcome.out.split("\n"))
    data = openprc("validate", path, "--json").data
    assert (data["ok"], data["findings"], data["profile"]) == (True, [], "default")


def test_levels_choose_what_is_shown_and_change_no_code(openprc, make_file):
    path = make_file()  # valid, and says nothing of an input
    assert "hint OPS-I04" in openprc("validate", path).text
    for level in ("warning", "error"):
        outcome = openprc("validate", path, "--level", level)
        assert (outcome.code, "OPS-I04" in outcome.text) == (0, False)
        data = openprc("validate", path, "--level", level, "--json").data
        assert (data["findings"], data["counts"]["hint"]) == ([], 1)


def test_profiles_demand_more(openprc, make_file):
    path = make_file()
    assert openprc("validate", path).code == 0
    outcome = openprc("validate", path, "--profile", "benchmark")
    assert outcome.code == 1
    assert "not valid" in outcome.text
    assert openprc("validate", make_file("d.h5", inputs=True), "--profile", "benchmark").code == 0


def test_several_files_at_once(openprc, make_file, tmp_path):
    good, invalid = make_file("good.h5"), make_file("invalid.h5")
    edit(invalid, lambda file: file.attrs.update(dims=2))
    (tmp_path / "text.h5").write_text("text")
    for words, code in ((["good.h5"], 0), (["good.h5", "invalid.h5"], 1),
                        (["invalid.h5", "text.h5"], 2), (["text.h5", "good.h5"], 2)):  # fmt: skip
        assert openprc("validate", *words).code == code
        data = openprc("validate", *words, "--json").data
        assert len(data if isinstance(data, list) else [data]) == len(words)
    assert good.exists()


# --- repair ------------------------------------------------------------------------------------


def test_repair_saves_what_was_committed(openprc, partial_file, tmp_path):
    before = partial_file.read_bytes()
    outcome = openprc("repair", partial_file)
    assert outcome.code == 0
    assert "7 frames saved, status interrupted" in outcome.text
    assert "is still there" in outcome.text
    assert partial_file.read_bytes() == before
    assert validate_file(tmp_path / "cut.h5").ok
    with Trajectory(tmp_path / "cut.h5") as trajectory:
        np.testing.assert_allclose(trajectory.time, 0.1 * np.arange(7))
    again = openprc("repair", partial_file)
    assert (again.code, "--force" in again.text) == (2, True)
    data = openprc("repair", partial_file, "--out", "else.h5", "--json").data
    assert data == {"path": "else.h5", "n_frames": 7, "status": "interrupted"}


def test_repair_refuses_what_is_whole(openprc, make_file):
    outcome = openprc("repair", make_file())
    assert outcome.code == 2
    assert "this file is complete" in outcome.text


def test_a_missing_file_whose_run_did_not_finish_says_so(openprc, partial_file):
    outcome = openprc("info", "cut.h5")
    assert outcome.code == 2
    assert "cut.h5.partial is there" in outcome.text
    assert "openprc repair" in outcome.text


# --- pack --------------------------------------------------------------------------------------


def test_pack_is_smaller_and_the_same(openprc, make_file, tmp_path):
    path = make_file(n_frames=2000)
    outcome = openprc("pack", path)
    assert outcome.code == 0
    assert "verified" in outcome.text
    packed = tmp_path / "run.packed.h5"
    assert packed.stat().st_size < path.stat().st_size
    with Trajectory(path) as one, Trajectory(packed) as two:
        assert one.content_digest() == two.content_digest()
        assert two.provenance["parents"] == [one.run_id]
    assert validate_file(packed).ok
    assert openprc("pack", path).code == 2
    data = openprc("pack", path, "--force", "--json").data
    assert data["path"] == str(packed)
    assert data["bytes_before"] == path.stat().st_size
    assert data["bytes_after"] == packed.stat().st_size


# --- migrate -----------------------------------------------------------------------------------


def test_a_present_file_is_left_alone(openprc, make_file, tmp_path):
    path = make_file()
    outcome = openprc("migrate", path, "--out", "new.h5")
    assert outcome.code == 0
    assert "nothing to do" in outcome.text
    data = openprc("migrate", path, "--out", "new.h5", "--json").data
    assert data == {"path": str(path), "schema": "1.0", "migrated": False}
    assert not (tmp_path / "new.h5").exists()


@pytest.mark.parametrize(
    ("version", "words"),
    [
        ("2.0", "the file follows schema 2.0"),
        ("0.3", "there is no way from schema 0 to 1"),
        ("new", "the version is 'new'"),
        (None, "the file states no version"),
    ],
)
def test_versions_without_a_way(openprc, make_file, tmp_path, version, words):
    def change(file):
        del file.attrs["openprc_schema"]
        if version is not None:
            file.attrs["openprc_schema"] = version

    path = edit(make_file(), change)
    outcome = openprc("migrate", path, "--out", "new.h5")
    assert outcome.code == 2
    assert words in outcome.text
    assert not (tmp_path / "new.h5").exists()


def test_a_step_is_taken(openprc, make_file, tmp_path, monkeypatch):
    from openprc.schema import migrate

    path = edit(make_file(), lambda file: file.attrs.update(openprc_schema="0.9"))
    monkeypatch.setitem(migrate.STEPS, 0, lambda file: file.attrs.update(comment="carried"))
    outcome = openprc("migrate", path, "--out", "new.h5")
    assert outcome.code == 0
    assert "schema 0.9 carried to 1.0" in outcome.text
    with h5py.File(tmp_path / "new.h5") as new, h5py.File(path) as old:
        assert (new.attrs["openprc_schema"], new.attrs["comment"]) == ("1.0", "carried")
        assert old.attrs["openprc_schema"] == "0.9"


# --- benchmark ---------------------------------------------------------------------------------


def test_benchmark_prints_a_score_and_writes_nothing(openprc, make_file, tmp_path):
    path = make_file(n_frames=400, inputs=True)
    outcome = openprc("benchmark", path)
    assert outcome.code == 0
    for words in ("narma2", "shift register", "ESN", "input drive/u", "standard deviation"):
        assert words in outcome.text
    data = openprc("benchmark", path, "--json").data
    assert (data["task"], data["input_name"], data["clock"]) == ("narma2", "drive", "symbols")
    assert 0 < data["nrmse"] < 2
    assert data["skill"] == pytest.approx(1 - data["nrmse"] / data["baseline"])
    assert [p.name for p in tmp_path.iterdir()] == ["run.h5"]


def test_benchmark_writes_where_it_is_told_to(openprc, make_file, tmp_path):
    path = make_file(n_frames=400, inputs=True)
    data = openprc("benchmark", path, "--out", "scores", "--features", "channels", "--json").data
    for key, kind in (("readout_path", "readout"), ("metrics_path", "metrics")):
        told = openprc("info", data[key], "--json").data
        assert told["kind"] == kind
    text = openprc("benchmark", path, "--out", "more").text
    assert "written: " in text


def test_a_feature_of_a_plugin_can_be_used(openprc, csv_plugin, make_file):
    path = make_file(n_frames=400, inputs=True)
    outcome = openprc("benchmark", path, "--features", "node-speeds", "--json")
    assert outcome.code == 0
    assert outcome.data["nrmse"] > 0


def test_a_feature_that_cannot_be_made(openprc, install, make_file):
    from openprc.hooks import FeatureSpec

    def refuses():
        raise ZeroDivisionError("1/0")

    spec = FeatureSpec("odd", "An odd one", install.code("Feature", refuses))
    install(odd={"openprc_features": [spec]})
    outcome = openprc("benchmark", make_file(inputs=True), "--features", "odd")
    assert outcome.code == 1
    assert "the plugin openprc-odd/odd failed while being set up: ZeroDivisionError" in outcome.text


# --- damage ------------------------------------------------------------------------------------


def test_a_flipped_byte_of_data_is_noticed(openprc, make_file, tmp_path):
    # Of the data only: what HDF5 itself does about damaged metadata is not ours to test.
    good = make_file(n_frames=200, inputs=True)
    with h5py.File(good) as file:
        chunks = {}
        for name in ("time_series/time", "time_series/nodes/positions", "inputs/drive/value",
                     "time_series/channels/gauge"):  # fmt: skip
            item = file[name].id
            assert item.get_num_chunks() > 0, name
            chunks[name] = item.get_chunk_info(0).byte_offset
    bad = tmp_path / "bad.h5"
    for name, offset in chunks.items():
        data = bytearray(good.read_bytes())
        data[offset + 3] ^= 0x40
        bad.write_bytes(bytes(data))
        outcome = openprc("validate", bad)
        assert outcome.code in (1, 2), name
        assert "not valid" in outcome.text
        assert "a fault of openprc" not in openprc("info", bad).text


ODD = [np.nan, "", b"\xff\xfe", 7, -1.5, np.zeros(3), np.array(["a", "b"], dtype="S1"),
       h5py.Empty("f8"), np.True_]  # fmt: skip


@pytest.mark.parametrize("shift", [0, 4])
def test_odd_attributes_never_give_an_internal_error(openprc, make_file, tmp_path, shift):
    good = make_file(inputs=True)
    places = []
    with h5py.File(good) as file:
        places += [("/", name) for name in file.attrs]
        file.visititems(lambda path, item: places.extend((path, name) for name in item.attrs))
    assert len(places) > 30
    for number, (owner, name) in enumerate(places):
        bad = tmp_path / "bad.h5"
        shutil.copy(good, bad)
        with h5py.File(bad, "r+") as file:
            file[owner].attrs[name] = ODD[(number + shift) % len(ODD)]
        for words in (["validate", bad], ["info", bad]):
            outcome = openprc(*words)
            assert outcome.code in (0, 1, 2)
            assert "a fault of openprc" not in outcome.text, (owner, name, words, outcome.text)


@pytest.mark.filterwarnings("ignore:Casting complex values")
@pytest.mark.parametrize(
    "value",
    [1.0, np.zeros(2), np.zeros((2, 3)), np.zeros((2, 3, 4)), np.array([b"a", b"b"]),
     np.zeros((0, 3)), h5py.Empty("f8"), np.zeros(40, dtype="i1"), np.zeros(40, dtype="c16")],
    ids=["scalar", "1d", "2d", "3d", "text", "none", "null", "ints", "complex"],
)  # fmt: skip
def test_odd_datasets_never_give_an_internal_error(openprc, make_file, tmp_path, value):
    good = make_file(inputs=True)
    places = []
    with h5py.File(good) as file:
        file.visititems(
            lambda path, item: places.append(path) if isinstance(item, h5py.Dataset) else None
        )
    for path in places:
        bad = tmp_path / "bad.h5"
        shutil.copy(good, bad)
        with h5py.File(bad, "r+") as file:
            attrs = dict(file[path].attrs)
            del file[path]
            file.create_dataset(path, data=value).attrs.update(attrs)
        for words in (["validate", bad], ["info", bad]):
            outcome = openprc(*words)
            assert outcome.code in (0, 1, 2)
            assert "a fault of openprc" not in outcome.text, (path, words, outcome.text)
