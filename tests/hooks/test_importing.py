"""From a foreign file to a validated result, or to nothing at all under the final name."""

from __future__ import annotations

import hashlib

import h5py
import numpy as np
import pytest

from openprc.errors import (
    NoImporter,
    PluginError,
    ResultExists,
    SchemaError,
    UnreadableFile,
    UntrustedPickle,
)
from openprc.hooks import OptionSpec, default_registry, discovery, import_file
from openprc.schema import Trajectory, validate_file
from openprc.schema.safety import load_pickle

N_FRAMES = 5


class Good:
    """Two nodes, of which one moves."""

    def sniff(self, path):
        return 0.9

    def declare(self, writer):
        writer.declare_nodes(2, 3, unit="m")

    def frames(self, writer, count=N_FRAMES):
        for i in range(count):
            writer.append(0.1 * i, positions=[[0.0, 0.0, 0.0], [1.0, 0.1 * i, 0.01 * i]])

    def import_run(self, path, writer, *, options):
        self.declare(writer)
        self.frames(writer)
        writer.note(f"options: {sorted(options)}")


def failing(error, *, after=2):
    class Failing(Good):
        def import_run(self, path, writer, *, options):
            self.declare(writer)
            self.frames(writer, after)
            raise error

    return Failing


def breaking(change):
    """Return an importer whose file is spoilt behind the writer's back."""

    class Invalid(Good):
        def import_run(self, path, writer, *, options):
            super().import_run(path, writer, options=options)
            writer.commit()
            change(writer._file)

    return Invalid


@pytest.fixture
def source(tmp_path):
    path = tmp_path / "source" / "run.fak"
    path.parent.mkdir()
    path.write_bytes(b"FAKE 1.0\n")
    return path


@pytest.fixture
def out(tmp_path):
    return tmp_path / "result" / "simulation.h5"


@pytest.fixture
def bring(registry_of, source, out):
    """Return a function that imports the source with an importer class."""

    def call(importer=Good, *, fields=None, path=source, target=out, **words):
        registry = registry_of({"fake": fields or {}}, fake=importer)
        return import_file(path, target, registry=registry, as_name="fake", **words)

    return call


def names_in(folder):
    return sorted(path.name for path in folder.iterdir())


def left_behind(out):
    return names_in(out.parent) if out.parent.exists() else []


# --- what goes well ----------------------------------------------------------------------------


def test_the_result_is_valid_and_described(bring, out):
    run = bring()
    assert (run.path, run.producer, run.confidence) == (out, "fake", 1.0)
    assert (run.n_frames, run.n_nodes, run.dims, run.n_channels) == (N_FRAMES, 2, 3, 0)
    assert (run.inputs, run.time_kind) == ((), "physical")
    assert run.notes == ("options: []",)
    assert [finding.code for finding in run.findings] == ["OPS-I04"]
    assert run.seconds > 0
    assert left_behind(out) == ["simulation.h5"]
    assert validate_file(out).ok
    plain = run.as_dict()
    assert plain["path"] == str(out)
    assert plain["findings"][0]["code"] == "OPS-I04"


def test_the_importer_is_chosen_by_what_it_says(registry_of, source, out):
    run = import_file(source, out, registry=registry_of(fake=Good))
    assert (run.producer, run.confidence) == ("fake", 0.9)


def test_the_default_registry_is_used(make_entry, make_code, producer, monkeypatch, source, out):
    spec = producer("fake", make_code("Good", Good))
    monkeypatch.setattr(
        discovery, "installed_entry_points", lambda: [make_entry(openprc_producers=[spec])]
    )
    default_registry.cache_clear()
    assert import_file(source, out).producer == "fake"


def test_provenance_says_who_from_what_and_how(bring, source, out, monkeypatch):
    monkeypatch.setattr("sys.argv", ["/somewhere/bin/openprc", "import", "data/run.fak"])
    options = (
        OptionSpec("unit", "unit", default="m"),
        OptionSpec("model", "model", kind="path"),
        OptionSpec("rods", "rods", multiple=True),
    )
    bring(fields={"options": options}, options={"model": "deep/folder/arm.urdf"})
    with Trajectory(out) as trajectory:
        told = trajectory.provenance
    assert (told["producer"], told["producer_version"]) == ("fake", "0.1")
    assert (told["plugin"], told["plugin_version"]) == ("openprc-fake", "0.1")
    assert told["command"] == "openprc import run.fak"
    # Base names only, and only what was set.
    assert told["config"] == {"unit": "m", "model": "arm.urdf"}
    (row,) = told["inputs"]
    data = source.read_bytes()
    assert row == {
        "role": "source",
        "name": "run.fak",
        "bytes": len(data),
        "sha256": hashlib.sha256(data).hexdigest(),
    }
    assert told["notes"] == ["options: ['model', 'rods', 'unit']"]


def test_the_source_is_untouched(bring, source):
    before = (source.read_bytes(), source.stat().st_mtime_ns, names_in(source.parent))
    bring()
    with pytest.raises(PluginError):
        bring(failing(ZeroDivisionError()), overwrite=True)
    assert (source.read_bytes(), source.stat().st_mtime_ns, names_in(source.parent)) == before


def test_importing_twice_gives_one_content(bring, tmp_path):
    digests = set()
    for name in ("a.h5", "b.h5"):
        bring(target=tmp_path / name)
        with Trajectory(tmp_path / name) as trajectory:
            digests.add(trajectory.content_digest())
    assert len(digests) == 1


def test_a_folder_is_imported_and_hashed(bring, source, out):
    bring(path=source.parent)
    with Trajectory(out) as trajectory:
        (row,) = trajectory.provenance["inputs"]
    assert (row["name"], row["bytes"]) == ("source", len(source.read_bytes()))


# --- what goes wrong ---------------------------------------------------------------------------


@pytest.mark.parametrize("after", [0, 2])
@pytest.mark.parametrize(
    "error",
    [ZeroDivisionError("division by zero"), SystemExit(0), MemoryError(), GeneratorExit(),
     ValueError("a\nb"), OSError(28, "No space left")],
)  # fmt: skip
def test_an_importer_that_fails_leaves_nothing(bring, out, source, error, after):
    with pytest.raises(PluginError, match="plugin openprc-fake/fake failed while") as caught:
        bring(failing(error, after=after))
    assert f"importing run.fak: {type(error).__name__}" in caught.value.found
    assert caught.value.file == str(source)
    assert caught.value.exit_code == 1
    assert caught.value.__cause__ is error
    assert left_behind(out) == []


def test_an_error_of_the_family_passes_unchanged(bring, out):
    error = UnreadableFile("line 3 is short", file="run.fak", key="line 3")
    with pytest.raises(UnreadableFile) as caught:
        bring(failing(error))
    assert caught.value is error
    assert left_behind(out) == []


def test_ctrl_c_passes_and_leaves_nothing(bring, out):
    with pytest.raises(KeyboardInterrupt):
        bring(failing(KeyboardInterrupt()))
    assert left_behind(out) == []


def test_debug_raises_what_the_importer_raised(bring, out, monkeypatch):
    monkeypatch.setenv("OPENPRC_PLUGIN_DEBUG", "1")
    with pytest.raises(ZeroDivisionError):
        bring(failing(ZeroDivisionError()))
    assert left_behind(out) == []


def test_an_importer_with_the_wrong_signature(bring, out):
    class Wrong(Good):
        def import_run(self, path):
            raise AssertionError

    class Without:
        def sniff(self, path):
            return 1.0

    for importer, words in ((Wrong, "TypeError"), (Without, "no attribute 'import_run'")):
        with pytest.raises(PluginError, match=words):
            bring(importer)
        assert left_behind(out) == []


def set_unit(file):
    file["time_series/nodes/positions"].attrs["unit"] = "furlong"


def set_indices(file):
    file.create_dataset("topology/bars/indices", data=np.array([[0, 9]], dtype="i4"))


def set_extension(file):
    file.create_group("extensions/openprc-fake")


def set_time(file):
    file["time_series/time"][1] = np.nan


@pytest.mark.parametrize(
    ("change", "words", "key"),
    [
        (set_unit, "OPS-L07: unknown unit 'furlong'", "/time_series/nodes/positions"),
        (set_indices, "OPS-E01: node 9", "/topology/bars/indices"),
        (set_extension, "OPS-X01: attribute version is missing", "/extensions/openprc-fake"),
        (set_time, "OPS-T01: nan at frame 1", "/time_series/time"),
    ],
)
def test_an_invalid_result_is_refused_by_code(bring, out, change, words, key):
    with pytest.raises(SchemaError, match=words) as caught:
        bring(breaking(change))
    assert (caught.value.file, caught.value.key) == (str(out), key)
    assert caught.value.expected
    assert left_behind(out) == []


def test_of_many_errors_the_first_is_named_and_the_rest_counted(bring):
    def change(file):
        set_unit(file)
        set_indices(file)

    with pytest.raises(SchemaError, match=r"OPS-E01: node 9 \(and 1 more\)"):
        bring(breaking(change))


def test_an_importer_that_writes_nothing(bring, out):
    class Idle(Good):
        def import_run(self, path, writer, *, options):
            pass

    with pytest.raises(SchemaError, match="no frame was appended"):
        bring(Idle)
    assert left_behind(out) == []


def test_an_importer_that_breaks_the_rules_of_the_writer(bring, out):
    class Backwards(Good):
        def import_run(self, path, writer, *, options):
            self.declare(writer)
            self.frames(writer)
            self.frames(writer)

    with pytest.raises(SchemaError, match=r"strictly increasing|increase"):
        bring(Backwards)
    assert left_behind(out) == []


# --- what is there already ---------------------------------------------------------------------


def digest(path):
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_an_existing_result_is_kept(bring, out):
    bring()
    before = digest(out)
    with pytest.raises(ResultExists, match="there is a finished file of this name") as caught:
        bring()
    assert "--force" in caught.value.fix
    assert digest(out) == before


@pytest.mark.parametrize(
    "importer",
    [failing(ZeroDivisionError()), failing(KeyboardInterrupt()), breaking(set_unit)],
)
def test_overwriting_happens_on_success_only(bring, out, importer):
    bring()
    before = digest(out)
    with pytest.raises((PluginError, SchemaError, KeyboardInterrupt)):
        bring(importer, overwrite=True)
    assert digest(out) == before
    assert left_behind(out) == ["simulation.h5"]
    bring(overwrite=True)
    assert digest(out) != before


def test_a_leftover_partial_file_is_not_overwritten_unasked(bring, out):
    out.parent.mkdir()
    leftover = out.with_name(out.name + ".partial")
    leftover.write_bytes(b"somebody's frames")
    with pytest.raises(ResultExists, match="an unfinished file of this name"):
        bring()
    assert leftover.read_bytes() == b"somebody's frames"
    bring(overwrite=True)
    assert left_behind(out) == ["simulation.h5"]


def test_the_source_is_never_replaced(bring, source):
    before = source.read_bytes()
    for target in (source, source.parent / ".." / "source" / "run.fak"):
        with pytest.raises(ResultExists, match="would replace what is imported"):
            bring(target=target, overwrite=True)
    assert source.read_bytes() == before
    assert names_in(source.parent) == ["run.fak"]


def test_a_folder_as_output_is_refused(bring, tmp_path):
    with pytest.raises((UnreadableFile, ResultExists)):
        bring(target=tmp_path, overwrite=True)


def test_nothing_is_made_when_nobody_reads_the_file(registry_of, source, out):
    with pytest.raises(NoImporter):
        import_file(source, out, registry=registry_of(fake=lambda path: 0.0))
    assert not out.parent.exists()


# --- pickles -----------------------------------------------------------------------------------


class Pickled(Good):
    def import_run(self, path, writer, *, options):
        load_pickle(path, trust=options["trust"])
        super().import_run(path, writer, options=options)


@pytest.mark.parametrize("trust", [False, True])
def test_pickles_need_the_word_of_the_caller(bring, tmp_path, out, trust):
    path = tmp_path / "run.pkl"
    path.write_bytes(b"\x80\x04]\x94.")  # an empty list
    fields = {"trusts_pickle": True}
    if trust:
        bring(Pickled, path=path, fields=fields, trust=True)
        with Trajectory(out) as trajectory:
            assert trajectory.provenance["config"] == {"trust": True}
        return
    with pytest.raises(UntrustedPickle, match="can run code") as caught:
        bring(Pickled, path=path, fields=fields)
    assert "--trust" in caught.value.fix
    assert left_behind(out) == []


def test_the_result_says_complete(bring, out):
    bring()
    with h5py.File(out) as file:
        assert file.attrs["status"] == "complete"
