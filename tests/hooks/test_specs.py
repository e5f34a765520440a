"""Records are checked when they are made, and do not change afterwards."""

from __future__ import annotations

import dataclasses
import pickle

import pytest

from openprc.hooks import OptionSpec, ProducerSpec, specs
from openprc.hooks.hookspecs import RECORDS
from openprc.hooks.specs import CodeSpec

CODE_SPECS = [kind for kind in RECORDS.values() if kind is not ProducerSpec]


def example(kind):
    if kind is ProducerSpec:
        return ProducerSpec("x", "An x", "a.b:C", ("import",))
    if kind is OptionSpec:
        return OptionSpec("x", "An x")
    return kind("x", "An x", "a.b:C")


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"name": ""}, "ProducerSpec.name is ''; expected lower-case letters"),
        ({"name": "Csv"}, "ProducerSpec.name is 'Csv'"),
        ({"name": "a b"}, "ProducerSpec.name is 'a b'"),
        ({"name": "a/b"}, "ProducerSpec.name is 'a/b'"),
        ({"name": "-a"}, "ProducerSpec.name is '-a'"),
        ({"name": "a\n"}, "ProducerSpec.name is 'a\\\\n'"),
        ({"name": None}, "ProducerSpec.name is None"),
        ({"name": 7}, "ProducerSpec.name is 7"),
        ({"summary": " "}, "ProducerSpec 'fake' has no summary"),
        ({"load": ""}, "ProducerSpec.load is ''; expected 'package.module:attribute'"),
        ({"load": "a.b"}, "ProducerSpec.load is 'a.b'"),
        ({"load": "a.b:"}, "ProducerSpec.load is 'a.b:'"),
        ({"load": "a.b:c.d"}, "ProducerSpec.load is 'a.b:c.d'"),
        ({"load": "a-b:c"}, "ProducerSpec.load is 'a-b:c'"),
        ({"load": "a.b:c()"}, "ProducerSpec.load is"),
        ({"load": ProducerSpec}, "ProducerSpec.load is <class"),
        ({"sample": "nothing"}, "ProducerSpec.sample is 'nothing'"),
        ({"capabilities": ()}, r"capabilities are \(\); expected some of"),
        ({"capabilities": ("export",)}, r"capabilities are \('export',\)"),
        ({"capabilities": "import"}, "capabilities are 'import'"),
        ({"needs": {"run": ("x",)}}, r"needs names \['run'\], which it is not capable of"),
        ({"elements": ("bars", "springs")}, r"elements \['springs'\] are not known"),
        ({"suffixes": ("csv",)}, "suffix 'csv'; expected lower case, leading dot"),
        ({"suffixes": (".CSV",)}, "suffix '.CSV'"),
        (
            {"options": (OptionSpec("a", "A"), OptionSpec("a", "A"))},
            r"two options share a name: \['a', 'a'\]",
        ),
    ],
)
def test_wrong_producers(producer, fields, words):
    with pytest.raises(ValueError, match=words):
        producer(**fields)


@pytest.mark.parametrize("kind", CODE_SPECS)
@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"name": "A"}, "name is 'A'; expected lower-case"),
        ({"summary": ""}, "has no summary; expected one line"),
        ({"load": "a.b.C"}, "load is 'a.b.C'; expected 'package.module:attribute'"),
    ],
)
def test_wrong_code_records_name_their_kind(kind, fields, words):
    good = {"name": "x", "summary": "An x", "load": "a.b:C"}
    with pytest.raises(ValueError, match=rf"{kind.__name__}[ .].*{words}"):
        kind(**{**good, **fields})


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"name": "Dt"}, "OptionSpec.name is 'Dt'"),
        ({"kind": "number"}, "OptionSpec.kind is 'number'; expected str, float, int"),
        ({"kind": float}, "OptionSpec.kind is <class 'float'>"),
    ],
)
def test_wrong_options(fields, words):
    with pytest.raises(ValueError, match=words):
        OptionSpec(**{"name": "dt", "help": "Time step", **fields})


@pytest.mark.parametrize("name", ["a", "0", "csv", "node-speeds", "merlin2", "a.b", "a_b"])
def test_good_names(producer, name):
    assert producer(name).name == name


@pytest.mark.parametrize("kind", [*RECORDS.values(), OptionSpec, CodeSpec])
def test_records_are_frozen_and_slotted(kind):
    record = example(kind)
    for name in ("name", "something_new"):
        with pytest.raises((dataclasses.FrozenInstanceError, AttributeError, TypeError)):
            setattr(record, name, "other")
    assert not hasattr(record, "__dict__")


def test_needs_cannot_be_changed_from_outside(producer):
    needs = {"import": ["x"]}
    record = producer(needs=needs)
    needs["import"].append("y")
    assert dict(record.needs) == {"import": ("x",)}
    with pytest.raises(TypeError):
        record.needs["import"] = ()


@pytest.mark.parametrize("kind", CODE_SPECS)
def test_kinds_are_not_mistaken_for_each_other(kind):
    others = [other for other in RECORDS.values() if other is not kind]
    assert not any(isinstance(example(kind), other) for other in others)


@pytest.mark.parametrize("kind", CODE_SPECS)
def test_code_records_are_equal_by_value_and_can_be_pickled(kind):
    record = example(kind)
    assert record == example(kind)
    assert hash(record) == hash(example(kind))
    assert pickle.loads(pickle.dumps(record)) == record


def test_elements_are_a_closed_list_without_doubles():
    assert len(set(specs.ELEMENTS)) == len(specs.ELEMENTS)
