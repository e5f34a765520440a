"""Choosing an importer: who is asked, who wins, and what a user is told otherwise."""

from __future__ import annotations

import math

import numpy as np
import pytest

from openprc.errors import (
    AmbiguousFile,
    MissingDependency,
    NoImporter,
    OpenPRCError,
    PluginError,
    UnknownName,
    UnreadableFile,
)
from openprc.hooks.faults import PluginWarning
from openprc.hooks.registry import Registry
from openprc.hooks.sniff import choose_importer, hinted

ABSENT = "no_such_package_zq"


@pytest.fixture
def file(tmp_path):
    path = tmp_path / "run.fak"
    path.write_bytes(b"FAKE 1.0\nsomething\n")
    return path


@pytest.fixture
def choose(registry_of):
    """Return a function that chooses among importers given by their sniff()."""

    def call(path, *, fields=None, as_name=None, **importers):
        registry = registry_of(fields, **importers)
        # Only those of the test: the ones of the package are tested with their own files.
        registry.plugins = tuple(p for p in registry.plugins if p.name != "builtin")
        return choose_importer(path, registry=registry, as_name=as_name)

    return call


def sure(score):
    return lambda path: score


def raising(error):
    def sniff(path):
        raise error

    return sniff


# --- who wins ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("scores", "winner"),
    [
        ({"a": 1.0, "b": 0.7}, "a"),
        ({"a": 0.7, "b": 1.0}, "b"),
        ({"a": 0.5, "b": 0.4999}, "a"),
        ({"a": 0.0, "b": 1}, "b"),
        ({"a": 0.6, "b": np.float32(0.7)}, "b"),
    ],
)
def test_the_surest_at_or_above_the_threshold_wins(choose, file, scores, winner):
    choice = choose(file, **{name: sure(score) for name, score in scores.items()})
    assert choice.item.name == winner
    assert choice.score == pytest.approx(max(scores.values()))
    assert {v.item.name: v.score for v in choice.verdicts} == pytest.approx(scores)


def test_equally_sure_importers_are_not_chosen_between(choose, file):
    importers = {"a": sure(0.7), "b": sure(0.7), "c": sure(0.6)}
    with pytest.raises(AmbiguousFile, match="openprc-a/a and openprc-b/b are equally") as caught:
        choose(file, **importers)
    assert "(0.7)" in caught.value.found
    assert "--as openprc-a/a" in caught.value.fix
    assert (caught.value.file, caught.value.exit_code) == (str(file), 2)
    choice = choose(file, as_name="b", **importers)
    assert (choice.item.name, choice.score, choice.verdicts) == ("b", 1.0, ())


def test_as_name_wins_over_a_sniff_that_says_no(choose, file):
    assert choose(file, as_name="a", a=sure(0.0), b=sure(1.0)).item.name == "a"
    assert choose(file, as_name="openprc-a/a", a=raising(ValueError())).item.name == "a"


def test_as_name_that_is_unknown_missing_or_unable(choose, file):
    with pytest.raises(UnknownName, match="no producer named 'b'"):
        choose(file, as_name="b", a=sure(1.0))
    fields = {"a": {"needs": {"import": (ABSENT,)}, "install": "pip install zeppelin"}}
    with pytest.raises(MissingDependency, match="a needs no_such_package_zq") as caught:
        choose(file, as_name="a", fields=fields, a=sure(1.0))
    assert caught.value.fix == "pip install zeppelin"
    with pytest.raises(UnknownName, match="a cannot import; it can run"):
        choose(file, as_name="a", fields={"a": {"capabilities": ("run",)}}, a=sure(1.0))


# --- the four messages -------------------------------------------------------------------------


def test_nobody_claims_it_and_who_was_asked(choose, file):
    with pytest.raises(NoImporter, match=r"no importer recognises it; asked: a 0\.3, b 0\n") as e:
        choose(file, a=sure(0.3), b=sure(0.0))
    assert e.value.expected == "one that is at least 0.5 sure"
    assert "--as a," in e.value.fix  # who is nearly sure knows best what is wrong
    with pytest.raises(NoImporter) as none:
        choose(file, a=sure(0.0))
    assert "--as NAME" in none.value.fix
    assert (e.value.file, e.value.exit_code) == (str(file), 2)


def test_nobody_at_all(choose, file):
    with pytest.raises(NoImporter, match="asked: nobody"):
        choose(file)


def test_the_likely_one_lacks_its_back_end(choose, file):
    fields = {
        "a": {
            "suffixes": (".fak",),
            "needs": {"import": (ABSENT,)},
            "install": "pip install zeppelin",
        }
    }
    with pytest.raises(NoImporter, match=f"lacks a package: a needs {ABSENT}") as caught:
        choose(file, fields=fields, a=sure(1.0), b=sure(0.3))
    assert caught.value.fix == "pip install zeppelin"


def test_an_unlikely_one_without_its_back_end_is_not_blamed(choose, file):
    fields = {"a": {"suffixes": (".xyz",), "needs": {"import": (ABSENT,)}}}
    with pytest.raises(NoImporter, match="no importer recognises it"):
        choose(file, fields=fields, a=sure(1.0), b=sure(0.3))


def test_another_that_can_read_it_wins_although_the_likely_one_lacks_its_back_end(choose, file):
    fields = {"a": {"suffixes": (".fak",), "needs": {"import": (ABSENT,)}}}
    assert choose(file, fields=fields, a=sure(1.0), b=sure(0.7)).item.name == "b"


@pytest.mark.parametrize(
    ("sniff", "words"),
    [
        (raising(ZeroDivisionError("1/0")), r"sniff\(\) raised ZeroDivisionError: 1/0"),
        (raising(SystemExit(3)), r"sniff\(\) raised SystemExit: 3"),
        (raising(UnreadableFile("odd")), "odd"),
        (sure(7), r"sniff\(\) returned 7"),
        (sure(-0.1), r"sniff\(\) returned -0\.1"),
        (sure(math.nan), r"sniff\(\) returned nan"),
        (sure(math.inf), r"sniff\(\) returned inf"),
        (sure(None), r"sniff\(\) returned None"),
        (sure("0.9"), r"sniff\(\) returned '0\.9'"),
        (sure("yes"), r"sniff\(\) returned 'yes'"),
        (sure(np.array([0.9, 0.1])), r"sniff\(\) returned array"),
        (lambda: 1.0, r"sniff\(\) raised TypeError"),
    ],
)
def test_the_only_likely_one_is_broken_and_why(choose, file, sniff, words):
    with pytest.raises(NoImporter, match=f"importer is broken: openprc-a/a: {words}") as caught:
        choose(file, fields={"a": {"suffixes": (".fak",)}}, a=sniff)
    assert "OPENPRC_PLUGIN_DEBUG=1" in caught.value.fix


def test_an_importer_without_sniff_or_that_cannot_be_made_is_broken(choose, file):
    class Dumb:
        pass

    class Refuses:
        def __init__(self):
            raise SystemExit(1)

    with pytest.raises(NoImporter, match=r"AttributeError.*has no attribute 'sniff'"):
        choose(file, a=Dumb)
    with pytest.raises(NoImporter, match="failed while being set up: SystemExit"):
        choose(file, a=Refuses)


def test_a_broken_importer_does_not_stop_the_others(choose, file):
    choice = choose(file, a=raising(SystemExit(1)), b=sure(0.8), c=sure(7))
    assert choice.item.name == "b"
    assert {v.item.name: v.problem for v in choice.verdicts} == {
        "a": "broken: sniff() raised SystemExit: 1",
        "b": "",
        "c": "broken: sniff() returned 7",
    }


def test_plugins_that_did_not_load_are_mentioned(make_entry, file):
    with pytest.warns(PluginWarning, match="zeppelin"):
        registry = Registry([make_entry("gone", content=ImportError("zeppelin"))])
    with pytest.raises(NoImporter) as caught:
        choose_importer(file, registry=registry)
    assert "plugins left out: gone (it cannot be imported: ImportError: zeppelin" in (
        caught.value.fix
    )


@pytest.mark.parametrize("error", [KeyboardInterrupt()])
def test_ctrl_c_passes(choose, file, error):
    with pytest.raises(KeyboardInterrupt):
        choose(file, a=raising(error))


def test_debug_raises(choose, file, monkeypatch):
    monkeypatch.setenv("OPENPRC_PLUGIN_DEBUG", "1")
    with pytest.raises(ZeroDivisionError, match="1/0"):
        choose(file, a=raising(ZeroDivisionError("1/0")))


def test_the_path_does_not_exist(choose, tmp_path):
    with pytest.raises(UnreadableFile, match="the file does not exist"):
        choose(tmp_path / "nothing.csv", a=sure(1.0))
    with pytest.raises(UnreadableFile, match=r"the folder .* does not exist either"):
        choose(tmp_path / "no" / "nothing.csv", a=sure(1.0))


def test_an_empty_file_or_folder_is_nobodys(choose, tmp_path):
    (tmp_path / "empty.csv").touch()
    (tmp_path / "folder").mkdir()
    for as_name in (None, "a"):
        with pytest.raises(UnreadableFile, match="the file is empty"):
            choose(tmp_path / "empty.csv", as_name=as_name, a=sure(1.0))
        with pytest.raises(UnreadableFile, match="the folder is empty"):
            choose(tmp_path / "folder", as_name=as_name, a=sure(1.0))


# --- who is asked ------------------------------------------------------------------------------


def test_folders_are_shown_to_every_importer(choose, file):
    seen = []

    def sniff(path):
        seen.append(path)
        return 0.7 if path.is_dir() else 0.0

    fields = {"a": {"suffixes": (".xyz",)}}
    assert choose(file.parent, fields=fields, a=sniff).item.name == "a"
    assert seen == [file.parent]


def test_hints_spare_the_others_from_being_asked(choose, file):
    fields = {"a": {"suffixes": (".fak",)}, "b": {"suffixes": (".xyz",)}}
    choice = choose(file, fields=fields, a=sure(0.6), b=sure(1.0))
    assert choice.item.name == "a"
    assert [v.item.name for v in choice.verdicts] == ["a"]


def test_without_a_likely_one_everybody_is_asked(choose, file):
    fields = {"a": {"suffixes": (".fak",)}, "b": {"suffixes": (".xyz",)}}
    choice = choose(file, fields=fields, a=sure(0.3), b=sure(0.8))
    assert choice.item.name == "b"
    assert [v.item.name for v in choice.verdicts] == ["a", "b"]


def test_producers_that_only_run_are_not_asked(choose, file):
    with pytest.raises(NoImporter, match="asked: nobody"):
        choose(file, fields={"a": {"capabilities": ("run",)}}, a=sure(1.0))


@pytest.mark.parametrize(
    ("name", "content", "hints", "fits"),
    [
        ("run.fak", b"x", {"suffixes": (".fak",)}, True),
        ("RUN.FAK", b"x", {"suffixes": (".fak",)}, True),
        ("run.tar.fak", b"x", {"suffixes": (".tar.fak",)}, True),
        ("run.txt", b"x", {"suffixes": (".fak",)}, False),
        ("run.txt", b"FAKE", {"magic": (b"FAKE",)}, True),
        ("run.txt", b"x" * 128 + b"FAKE", {"magic": (b"FAKE",)}, True),
        ("run.txt", b"x" * 4096 + b"FAKE", {"magic": (b"FAKE",)}, False),
        ("run.txt", b"FAKE", {"suffixes": (".fak",), "magic": (b"FAKE",)}, True),
        ("run.txt", b"x", {}, True),
    ],
)
def test_hints(producer, tmp_path, name, content, hints, fits):
    path = tmp_path / name
    path.write_bytes(content)
    assert hinted(producer(**hints), path) is fits


def test_sniffing_changes_nothing(choose, file):
    before = file.read_bytes()
    with pytest.raises(OpenPRCError):
        choose(file, a=sure(0.1))
    assert file.read_bytes() == before
    assert [p.name for p in file.parent.iterdir()] == [file.name]


def test_no_importer_is_of_the_plugin_family():
    assert issubclass(NoImporter, PluginError)
    assert issubclass(AmbiguousFile, PluginError)
