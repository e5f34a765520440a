"""Bad foreign files, options, plugins and experiments: the words, the code, nothing left."""

from __future__ import annotations

import json
import pickle

import h5py
import numpy as np
import pytest

OUT = "result.h5"


def missing(path):
    pass


def directory(path):
    path.mkdir()
    (path / "notes.txt").write_text("nothing to see")


def empty(path):
    path.touch()


def text(path):
    path.write_text("t,x\n0,1\n")


def other_hdf5(path):
    with h5py.File(path, "w") as file:
        file["x"] = np.zeros(3)


# --- files of other programs -------------------------------------------------------------------


CSV = [
    ("t,x0 [m],y0 [m]\n0,1,1\nnan,1,1\n", "time is nan"),
    ("t,x0 [m],y0 [m]\n0,1,1\n2,1,1\n1,1,1\n", "time is 1.0 after 2.0"),
    ("t,x0 [m],y0 [m]\n0,1,1\n0,1,1\n", "time is 0.0 after 0.0"),
    ("t,x0 [m],y0 [m]\n0,1\n1,1\n", ""),
    ("t,x0 [furlong],y0 [furlong]\n0,1,1\n1,1,1\n", "furlong"),
    ("t,x0,y0\n0,1,1\n1,1,1\n", "nothing says which unit"),
    ("t,x0 [m],y0 [m]\n0,1,inf\n1,1,1\n", ""),
]


@pytest.mark.parametrize(("content", "words"), CSV)
def test_a_csv_file_that_is_wrong(refused, csv_plugin, tmp_path, content, words):
    path = tmp_path / "run.csv"
    path.write_text(content)
    refused("import", path, "--out", OUT, "--as", "csv", told=words)


def test_options_of_an_importer(refused, csv_plugin, tmp_path):
    path = tmp_path / "run.csv"
    path.write_text("t,x0,y0\n0,1,1\n1,2,1\n")
    call = ("import", path, "--out", OUT)
    refused(*call, "-o", "untis=m", told=("csv has no option 'untis'", "did you mean 'unit'?"),
            kind="ConfigError")  # fmt: skip
    refused(*call, "-o", "dt=fast", told="option dt of csv is 'fast'", kind="ConfigError")
    refused(*call, "-o", "dt=nan", told="a finite number", kind="ConfigError")
    refused(*call, "-o", "dt=1", "-o", "dt=2", told="given 2 times", kind="ConfigError")
    refused(*call, "-o", "unit=furlong", told="unknown unit 'furlong'", kind="UnitError")


@pytest.mark.parametrize(
    ("make", "words", "kind"),
    [
        (missing, "does not exist", "UnreadableFile"),
        (empty, "the file is empty", "UnreadableFile"),
        (directory, "no importer recognises it; asked: ", "NoImporter"),
        (text, "no importer recognises it; asked: ", "NoImporter"),
        (other_hdf5, "no importer recognises it; asked: ", "NoImporter"),
        (lambda path: path.mkdir(), "the folder is empty", "UnreadableFile"),
        (lambda path: path.write_bytes(bytes(range(256)) * 20), "no importer", "NoImporter"),
    ],
)
def test_what_nobody_imports(refused, tmp_path, make, words, kind):
    path = tmp_path / "thing.dat"
    make(path)
    refused("import", path, "--out", OUT, told=words, kind=kind)


# --- plugins -----------------------------------------------------------------------------------


class Importer:
    """Reads anything."""

    score = 0.9

    def sniff(self, path):
        return self.score

    def import_run(self, path, writer, *, options):
        writer.declare_nodes(1, 2, unit="m")
        writer.append([0.0, 1.0], positions=np.zeros((2, 1, 2)))


class Raises(Importer):
    def import_run(self, path, writer, *, options):
        super().import_run(path, writer, options=options)
        raise SystemExit(0)


class Pickled(Importer):
    def import_run(self, path, writer, *, options):
        from openprc.schema.safety import load_pickle

        load_pickle(path, trust=options["trust"])
        super().import_run(path, writer, options=options)


@pytest.fixture
def thing(tmp_path):
    path = tmp_path / "thing.fak"
    path.write_bytes(pickle.dumps([1, 2, 3]))
    return path


def test_a_plugin_that_raises(refused, install, thing):
    install(bad={"openprc_producers": [install.importer("bad", Raises)]})
    refused("import", thing, "--out", OUT, code=1, kind="PluginError",
            told=("the plugin openprc-bad/bad failed while importing thing.fak: SystemExit: 0",
                  "OPENPRC_PLUGIN_DEBUG=1 shows the trace"))  # fmt: skip


def test_a_plugin_with_a_missing_back_end(refused, install, thing):
    spec = install.importer(
        "far", Importer, needs={"import": ("no_such_package_zq",)}, suffixes=(".fak",),
        install="pip install zeppelin",
    )  # fmt: skip
    install(far={"openprc_producers": [spec]})
    refused("import", thing, "--out", OUT, told=("far needs no_such_package_zq", "zeppelin"),
            kind="NoImporter")  # fmt: skip
    refused("import", thing, "--out", OUT, "--as", "far", kind="MissingDependency",
            told=("needs no_such_package_zq to import", "to do: pip install zeppelin"))  # fmt: skip


def test_two_plugins_of_one_name(refused, openprc, install, thing):
    install(
        one={"openprc_producers": [install.importer("same", Importer)]},
        two={"openprc_producers": [install.importer("same", Importer)]},
    )
    call = ("import", thing, "--out", OUT)
    refused(*call, told=("openprc-one/same and openprc-two/same are equally sure",
                         "--as openprc-one/same"), kind="AmbiguousFile")  # fmt: skip
    refused(*call, "--as", "same", told="2 plugins offer a producer named 'same'",
            kind="AmbiguousName")  # fmt: skip
    assert openprc(*call, "--as", "openprc-two/same").code == 0


def test_names_that_do_not_exist_or_do_not_fit(refused, thing, experiment_folder, make_file):
    refused("import", thing, "--out", OUT, "--as", "legcy", told="did you mean 'legacy'?",
            kind="UnknownName")  # fmt: skip
    refused("import", thing, "--out", OUT, "--as", "demlat", told="demlat cannot import",
            kind="UnknownName")  # fmt: skip
    refused("run", experiment_folder, "--producer", "demlta", told="did you mean 'demlat'?",
            kind="UnknownName")  # fmt: skip
    refused("run", experiment_folder, "--producer", "legacy", told="legacy cannot run",
            kind="UnknownName")  # fmt: skip
    refused("benchmark", make_file(inputs=True), "--features", "node-position",
            told="did you mean 'node-positions'?", kind="UnknownName")  # fmt: skip


def test_a_pickle_without_trust(refused, openprc, install, thing, tmp_path):
    spec = install.importer("pickled", Pickled, trusts_pickle=True)
    install(pickled={"openprc_producers": [spec]})
    refused("import", thing, "--out", OUT, told=("can run code", "--trust"),
            kind="UntrustedPickle")  # fmt: skip
    thing.write_bytes(pickle.dumps(print))
    refused("import", thing, "--out", OUT, "--trust", told="the pickle asks for builtins.print",
            kind="UnsafeFile")  # fmt: skip
    thing.write_bytes(pickle.dumps([1]))
    assert openprc("import", thing, "--out", OUT, "--trust").code == 0


@pytest.mark.filterwarnings("always")
def test_a_broken_plugin_is_told_once_and_the_rest_works(openprc, install, thing):
    install(
        gone=ImportError("no zeppelin"),
        fine={"openprc_producers": [install.importer("fine", Importer)]},
    )
    outcome = openprc("import", thing, "--out", OUT)
    assert outcome.code == 0
    told = [line for line in outcome.err.splitlines() if line.startswith("warning: ")]
    assert len(told) == 1
    assert "plugin gone (openprc-gone 0.1) is left out" in told[0]


# --- experiments -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda c: c["simulation"].update(duratoin=1.0), "did you mean 'duration'?"),
        (lambda c: c.update(pyhsics={}), "did you mean 'physics'?"),
        (lambda c: c["simulation"].update(dt=-1.0), "simulation.dt"),
        (lambda c: c["simulation"].update(dt=0.0003), "whole multiple"),
        (lambda c: c["simulation"].pop("duration"), "the key is missing"),
        (lambda c: c["actuators"][0].update(node=7), "a node from 0 to 1"),
        (lambda c: c["actuators"][0].update(signal="v"), "no signal is named 'v'"),
        (lambda c: c.update(openprc_config="2.0"), "layout version 2.0"),
    ],
)
def test_a_wrong_configuration(refused, experiment_folder, change, words):
    path = experiment_folder / "input" / "config.json"
    settings = json.loads(path.read_text())
    change(settings)
    path.write_text(json.dumps(settings))
    for command in ("run", "info"):
        refused(command, experiment_folder, told=(words, "config.json"))


@pytest.mark.parametrize(
    ("content", "words"),
    [('{"simulation": ', "invalid JSON at line 1"), ("[]", "the file holds a JSON list"),
     ('{"a": NaN}', "the number NaN"), ("", "the file is empty")],
)  # fmt: skip
def test_a_configuration_that_is_no_json(refused, experiment_folder, content, words):
    (experiment_folder / "input" / "config.json").write_text(content)
    refused("run", experiment_folder, told=(words, "config.json"))


def test_an_experiment_whose_bars_name_no_node(refused, experiment_folder):
    with h5py.File(experiment_folder / "input" / "geometry.h5", "r+") as file:
        file["elements/bars/indices"][0, 1] = 9
    refused("run", experiment_folder, told=("names node [0, 9]", "node numbers from 0 to 1"),
            kind="ConfigError")  # fmt: skip


# --- scores ------------------------------------------------------------------------------------


def test_what_cannot_be_scored(refused, make_file):
    refused("benchmark", make_file(), told="input", kind="MissingInputError")
    driven = make_file("driven.h5", inputs=True)
    refused("benchmark", driven, "--order", "0", told="the order is 0")
    refused("benchmark", driven, "--column", "v", told="has no column 'v'")
    refused("benchmark", driven, "--input", "drvie", told="drive")
    refused("benchmark", driven, "--washout", "-1", told="washout")
    refused("benchmark", driven, "--train", "1e6", told="shorten the spans")
    refused("benchmark", driven, "--ridge", "-1", told="'-1' is less than 0", kind="UsageError")
    refused("benchmark", driven, "--samples-per-symbol", "0", told="samples_per_symbol is 0")
    refused("benchmark", driven, "--out", driven, "--test", "0", told="test")
