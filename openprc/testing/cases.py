"""What is to be checked: a record, and what the kit cannot guess about it."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from openprc.hooks.registry import Registered, Registry, default_registry
from openprc.hooks.specs import Capability, ExporterSpec, ProducerSpec
from openprc.testing.check import Kind, all_checks
from openprc.testing.lookup import find_record, package_of

if TYPE_CHECKING:
    from openprc.schema import Experiment

#: Packages that no entry module may import, whatever the case says.
HEAVY = (
    "cv2", "elastica", "jax", "matplotlib", "meshio", "meshlane", "numba", "pandas", "pybullet",
    "pydantic", "scipy", "sklearn", "torch",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Case:
    """What all cases have in common.

    Parameters
    ----------
    spec : ProducerSpec, ExporterSpec, Registered or str
        The record, or its name.
    heavy : tuple of str
        Import names of packages that listing the plugin must not import, besides those that
        everybody knows to be slow.
    expected_failures : mapping of check id to reason
        Strict: a check that passes although it is in here fails.
    slow : tuple of str
        Ids of checks, or families of them, that `parametrize_with_checks` marks ``slow``.
    entry_module : str, optional
        The module of the entry point; that of the installed plugin, or the package of `load`.
    registry : Registry, optional
        Where names are looked up; the installed plugins by default.
    """

    spec: ProducerSpec | ExporterSpec | Registered | str
    heavy: tuple[str, ...] = field(default=(), kw_only=True)
    expected_failures: Mapping[str, str] = field(default_factory=dict, kw_only=True)
    slow: tuple[str, ...] = field(default=(), kw_only=True)
    entry_module: str = field(default="", kw_only=True)
    registry: Registry | None = field(default=None, kw_only=True)

    kind: ClassVar[Kind] = "importer"
    hook: ClassVar[str] = "openprc_producers"
    capability: ClassVar[Capability | None] = "import"

    def __post_init__(self) -> None:
        known = {item.id for item in all_checks() if self.kind in item.kinds}
        stray = sorted(set(self.expected_failures) - known)
        if stray:
            raise ValueError(
                f"expected_failures of {self.name} names {stray}; expected ids of checks for "
                f"{self.kind}s: {', '.join(sorted(known))}"
            )

    @property
    def name(self) -> str:
        """Bare name of the record."""
        return self.spec if isinstance(self.spec, str) else self.spec.name

    @cached_property
    def _found(self) -> tuple[Registered, Registry]:
        registry = self.registry or default_registry()
        return find_record(self.spec, self.hook, registry, self.entry_module)

    @property
    def item(self) -> Registered:
        """The record and the distribution it belongs to."""
        return self._found[0]

    @property
    def plugins(self) -> Registry:
        """The registry in which the record is found."""
        return self._found[1]

    @property
    def record(self) -> Any:
        """The record."""
        return self.item.spec

    @property
    def module(self) -> str:
        """The entry module."""
        if self.entry_module:
            return self.entry_module
        for plugin in self.plugins.plugins:
            if self.record in plugin.records.get(self.hook, ()) and (
                plugin.distribution == self.item.distribution
            ):
                return plugin.module
        return package_of(self.record.load)

    @property
    def needs(self) -> tuple[str, ...]:
        """Import names of what this capability says that it needs."""
        if isinstance(self.record, ExporterSpec):
            return self.record.needs
        return tuple(self.record.needs.get(self.capability, ()))

    @property
    def forbidden(self) -> tuple[str, ...]:
        """Import names that listing the plugin must not import."""
        return tuple(dict.fromkeys((*self.heavy, *self.needs, *HEAVY)))

    def is_slow(self, id: str) -> bool:
        """Whether that check is to be marked slow."""
        return id in self.slow or id.rpartition("-")[0] in self.slow


#: Writes a run into a folder; returns where it is, or a `Sample` that also has options.
MakeSample = Callable[[Path], Any]
#: What a run holds, in closed form; see `ImporterCase`.
Truth = Callable[[], Mapping[str, Any]]


@dataclass(frozen=True, eq=False)
class ImporterCase(Case):
    """A producer that imports.

    Parameters
    ----------
    spec : ProducerSpec, Registered or str
    make_sample : callable, optional
        ``make_sample(folder) -> Path | Sample`` writes a small run; by default the ``sample``
        of the record.
    truth : callable, optional
        Returns a mapping with what the imported sample must hold, in closed form, any of:
        ``positions`` (T, N, D) in ``unit`` (else as stored), ``observed`` (T, N),
        ``velocities``, ``time`` (T,) [unit of the file], ``inputs`` {name: (T,) or (T, C)},
        ``sequences`` {name: (K,) or (K, C)}, ``channels`` {name: (T, C)},
        ``elements`` {(kind, quantity): (T, E)}, and ``tolerance``, the largest deviation
        relative to the spread of the quantity (1e-9), or a mapping of these by name.
    trust : bool
        Whether the sample may only be read when pickles are trusted.
    lookalikes : tuple of str
        Producers whose samples are legitimately of this format, too.
    """

    make_sample: MakeSample | None = field(default=None, kw_only=True)
    truth: Truth | None = field(default=None, kw_only=True)
    trust: bool = field(default=False, kw_only=True)
    lookalikes: tuple[str, ...] = field(default=(), kw_only=True)


@dataclass(frozen=True, eq=False)
class RunnerCase(Case):
    """A producer that simulates experiments.

    Parameters
    ----------
    integrator : str, optional
        Instead of the one that the scenes of the kit name.
    dt_factor : float
        The time steps of the kit's scenes are multiplied by it.
    options : mapping
        Options of the runner.
    scene : callable, optional
        Returns an `Experiment` that the runner can model, driven by one input and with memory,
        where it cannot model the kit's driven oscillator or driven lattice.
    """

    integrator: str | None = field(default=None, kw_only=True)
    dt_factor: float = field(default=1.0, kw_only=True)
    options: Mapping[str, Any] = field(default_factory=dict, kw_only=True)
    scene: Callable[[], Experiment] | None = field(default=None, kw_only=True)

    kind: ClassVar[Kind] = "runner"
    capability: ClassVar[Capability | None] = "run"


@dataclass(frozen=True, eq=False)
class RecorderCase(Case):
    """A producer that records a loop which the user's script owns.

    Parameters
    ----------
    script : callable, optional
        ``script(out)`` simulates and records a small run into the file `out` and closes it.
    truth : callable, optional
        What that run must hold; see `ImporterCase`.
    forget : callable, optional
        The same as `script` without closing; called in a process of its own, so it has to be a
        function of a module.
    crash : callable, optional
        The same as `script`, and an exception is raised in the loop after some frames.
    """

    script: Callable[[Path], Any] | None = field(default=None, kw_only=True)
    truth: Truth | None = field(default=None, kw_only=True)
    forget: Callable[[Path], Any] | None = field(default=None, kw_only=True)
    crash: Callable[[Path], Any] | None = field(default=None, kw_only=True)

    kind: ClassVar[Kind] = "recorder"
    capability: ClassVar[Capability | None] = "record"


@dataclass(frozen=True, eq=False)
class ExporterCase(Case):
    """An exporter.

    Parameters
    ----------
    suffix : str, optional
        Ending of the files; the first of the record, or its name.
    options : mapping
        Options of the exporter.
    importer : str, optional
        Producer that reads the format back.
    import_options : mapping
    tolerance : float
        Largest deviation after the way out and back, relative to the spread.
    """

    suffix: str = field(default="", kw_only=True)
    options: Mapping[str, Any] = field(default_factory=dict, kw_only=True)
    importer: str | None = field(default=None, kw_only=True)
    import_options: Mapping[str, Any] = field(default_factory=dict, kw_only=True)
    tolerance: float = field(default=1e-12, kw_only=True)

    kind: ClassVar[Kind] = "exporter"
    hook: ClassVar[str] = "openprc_exporters"
    capability: ClassVar[Capability | None] = None


__all__ = ["HEAVY", "Case", "ExporterCase", "ImporterCase", "RecorderCase", "RunnerCase"]
