"""The records that plugins return: small, frozen, and checked when they are made.

A record names its code as ``"package.module:attribute"``. Nothing is imported to list,
match or explain a record; the code is loaded on first use.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any, Literal

Capability = Literal["run", "record", "import"]
CAPABILITIES: tuple[Capability, ...] = ("run", "record", "import")

#: What a producer may say that it can model. Closed, so that scenes can be matched to it.
ELEMENTS = (
    "nodes",
    "bars",
    "hinges",
    "bends",
    "faces",
    "rods",
    "rigid-bodies",
    "soft-bodies",
    "joints",
    "contact",
    "gravity",
    "damping",
    "position-actuators",
    "force-actuators",
    "velocity-actuators",
)

_NAME = re.compile(r"[a-z0-9][a-z0-9._-]*\Z")
_TARGET = re.compile(r"[A-Za-z_][\w.]*:[A-Za-z_]\w*\Z")


def _check_name(kind: str, name: object) -> None:
    if not isinstance(name, str) or not _NAME.match(name):
        raise ValueError(
            f"{kind}.name is {name!r}; expected lower-case letters, digits, '.', '_' or '-'"
        )


def _check_target(kind: str, key: str, target: object) -> None:
    if not isinstance(target, str) or not _TARGET.match(target):
        raise ValueError(f"{kind}.{key} is {target!r}; expected 'package.module:attribute'")


def _check_suffixes(kind: str, owner: str, suffixes: tuple[str, ...]) -> None:
    for suffix in suffixes:
        if not suffix.startswith(".") or suffix != suffix.lower():
            raise ValueError(
                f"{kind} {owner!r}: suffix {suffix!r}; expected lower case, leading dot"
            )


def _check_options(kind: str, owner: str, options: tuple[OptionSpec, ...]) -> None:
    names = [option.name for option in options]
    if len(set(names)) != len(names):
        raise ValueError(f"{kind} {owner!r}: two options share a name: {names}")


@dataclass(frozen=True, slots=True)
class OptionSpec:
    """One option of an importer, a runner or an exporter, typed for the command line.

    ``kind`` is ``str``, ``float``, ``int``, ``bool`` or ``path``; with ``multiple`` the value
    is a tuple of them. ``default`` is ``None`` when the option may stay unset.
    """

    name: str
    help: str
    kind: Literal["str", "float", "int", "bool", "path"] = "str"
    default: Any = None
    multiple: bool = False
    choices: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        _check_name("OptionSpec", self.name)
        if self.kind not in ("str", "float", "int", "bool", "path"):
            raise ValueError(f"OptionSpec.kind is {self.kind!r}; expected str, float, int, ...")


@dataclass(frozen=True, slots=True)
class ProducerSpec:
    """A source of trajectories: a simulator to run, a recorder to attach, or a file format.

    Parameters
    ----------
    name : str
        What users type, unique within its distribution.
    summary : str
        One line.
    load : str
        ``"package.module:attribute"`` of a class that is made without arguments and offers
        the protocols of `openprc.hooks.protocols` named in `capabilities`.
    capabilities : tuple of {"run", "record", "import"}
    suffixes, magic : tuple
        Hints for importers: file name endings (".npz") and leading bytes. They only order
        the candidates; `Importer.sniff` decides.
    needs : mapping of capability to import names
        What must be importable before that capability can be used; probed, not imported.
    install : str
        The command that installs what is missing.
    dims : tuple of int
        Dimensions of space that the producer can deliver.
    time : tuple of {"physical", "pseudo"}
    elements : tuple of str
        What it can model, from `ELEMENTS`.
    options : tuple of OptionSpec
        What `Importer.import_run` accepts.
    run_options : tuple of OptionSpec
        What `Runner.run` accepts besides the experiment. A runner without any is called
        without the argument `options`.
    trusts_pickle : bool
        The format can be a pickle; it is only read when the caller says ``trust=True``.
    citation : str
        What a paper that uses the producer should cite.
    sample : str
        ``"package.module:function"`` that writes a small run in the producer's own format
        (`openprc.hooks.protocols.SampleWriter`); the demo and the tests use it.
    """

    name: str
    summary: str
    load: str
    capabilities: tuple[Capability, ...]
    suffixes: tuple[str, ...] = ()
    magic: tuple[bytes, ...] = ()
    needs: Mapping[Capability, tuple[str, ...]] = field(default_factory=dict)
    install: str = ""
    dims: tuple[int, ...] = (2, 3)
    time: tuple[Literal["physical", "pseudo"], ...] = ("physical",)
    elements: tuple[str, ...] = ()
    options: tuple[OptionSpec, ...] = ()
    run_options: tuple[OptionSpec, ...] = ()
    trusts_pickle: bool = False
    citation: str = ""
    sample: str = ""

    def __post_init__(self) -> None:
        kind = "ProducerSpec"
        _check_name(kind, self.name)
        _check_target(kind, "load", self.load)
        if self.sample:
            _check_target(kind, "sample", self.sample)
        if not self.summary.strip():
            raise ValueError(f"{kind} {self.name!r} has no summary; expected one line")
        unknown = set(self.capabilities) - set(CAPABILITIES)
        if unknown or not self.capabilities:
            raise ValueError(
                f"{kind} {self.name!r}: capabilities are {self.capabilities!r}; "
                f"expected some of {CAPABILITIES}"
            )
        stray = set(self.needs) - set(self.capabilities)
        if stray:
            raise ValueError(
                f"{kind} {self.name!r}: needs names {sorted(stray)}, which it is not capable of"
            )
        unknown_elements = set(self.elements) - set(ELEMENTS)
        if unknown_elements:
            raise ValueError(
                f"{kind} {self.name!r}: elements {sorted(unknown_elements)} are not known; "
                f"expected some of {ELEMENTS}"
            )
        _check_suffixes(kind, self.name, self.suffixes)
        for options in (self.options, self.run_options):
            _check_options(kind, self.name, options)
        if self.run_options and "run" not in self.capabilities:
            raise ValueError(f"{kind} {self.name!r} has run_options, and cannot run")
        needs = {key: tuple(value) for key, value in self.needs.items()}
        object.__setattr__(self, "needs", MappingProxyType(needs))


@dataclass(frozen=True, slots=True)
class CodeSpec:
    """A named piece of code: the shape shared by the simpler records."""

    name: str
    summary: str
    load: str
    citation: str = ""

    def __post_init__(self) -> None:
        kind = type(self).__name__
        _check_name(kind, self.name)
        _check_target(kind, "load", self.load)
        if not self.summary.strip():
            raise ValueError(f"{kind} {self.name!r} has no summary; expected one line")


class FeatureSpec(CodeSpec):
    """A `openprc.hooks.protocols.Feature`: trajectory to (T, F) matrix with column names."""

    __slots__ = ()


class ReadoutSpec(CodeSpec):
    """A `openprc.hooks.protocols.Readout`: an estimator with ``fit`` and ``predict``."""

    __slots__ = ()


class TaskSpec(CodeSpec):
    """A `openprc.hooks.protocols.Task`: input sequence to target sequence."""

    __slots__ = ()


class BenchmarkSpec(CodeSpec):
    """A `openprc.hooks.protocols.Benchmark`: states and input to named numbers."""

    __slots__ = ()


class DetectorSpec(CodeSpec):
    """A `openprc.hooks.protocols.Detector`: image to points."""

    __slots__ = ()


@dataclass(frozen=True, slots=True)
class ExporterSpec(CodeSpec):
    """A `openprc.hooks.protocols.Exporter`: trajectory to a file of another format.

    Parameters
    ----------
    suffixes : tuple of str
        Endings of file names that choose this exporter; the one like its name always does.
    needs : tuple of str
        Import names without which it cannot write; probed, not imported.
    install : str
        The command that installs what is missing.
    options : tuple of OptionSpec
        What `Exporter.export` accepts.
    """

    suffixes: tuple[str, ...] = ()
    needs: tuple[str, ...] = ()
    install: str = ""
    options: tuple[OptionSpec, ...] = ()

    def __post_init__(self) -> None:
        CodeSpec.__post_init__(self)
        _check_suffixes("ExporterSpec", self.name, self.suffixes)
        _check_options("ExporterSpec", self.name, self.options)


class ExtensionSpec(CodeSpec):
    """A subtree ``/extensions/<name>`` of simulation.h5; ``load`` is its check.

    The check is a function ``(trajectory) -> Iterable[Finding]`` that the validator calls on
    files which contain the subtree.
    """

    __slots__ = ()
