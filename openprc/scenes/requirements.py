"""What a scene requires, and which of the installed producers can give it."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal

from openprc.errors import MissingDependency, OpenPRCError, PluginError
from openprc.hooks.faults import owned_by
from openprc.hooks.protocols import Describer, Modelled
from openprc.hooks.registry import Registered, Registry, default_registry, missing_packages
from openprc.scenes.physics import Physics, elements_of, physics_of
from openprc.schema.findings import Finding

if TYPE_CHECKING:
    from openprc.hooks.protocols import Runner
    from openprc.schema.experiment import Experiment

State = Literal["runs", "refuses", "unavailable", "broken"]


@dataclass(frozen=True, kw_only=True)
class ProducerVerdict:
    """What a producer would do with a scene.

    Parameters
    ----------
    producer : str
        The name that ``openprc run --producer`` takes.
    state : {"runs", "refuses", "unavailable", "broken"}
        "refuses": it cannot model something, see `findings`; "unavailable": a package that it
        drives is not installed; "broken": its own code fails.
    findings : tuple of Finding
        What it says about the scene: errors refuse, warnings and hints do not.
    leaves_out : tuple of str
        What the scene has and the producer's result does not show.
    adds : tuple of str
        What the producer models and the scene does not ask for.
    text : str
        One sentence: why it does not run, or what there is to mind.
    """

    producer: str
    state: State
    findings: tuple[Finding, ...] = ()
    leaves_out: tuple[str, ...] = ()
    adds: tuple[str, ...] = ()
    text: str = ""

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, for JSON."""
        return {
            "producer": self.producer,
            "state": self.state,
            "leaves_out": list(self.leaves_out),
            "adds": list(self.adds),
            "text": self.text,
            "findings": [finding.as_dict() for finding in self.findings],
        }


def producer_verdicts(
    experiment: Experiment, *, registry: Registry | None = None
) -> tuple[ProducerVerdict, ...]:
    """Ask every producer that runs experiments what it would do with this one.

    Nothing is run. A producer that fails at the question is "broken", and the others are asked
    all the same.

    Parameters
    ----------
    experiment : Experiment
    registry : Registry, optional
        The installed plugins by default.

    Returns
    -------
    tuple of ProducerVerdict
        Sorted by name; plugins that could not be loaded come last.

    Examples
    --------
    >>> from openprc.scenes.requirements import producer_verdicts
    >>> from openprc.schema.experiment import Experiment
    >>> from openprc.schema.geometry import Bars, Geometry
    >>> bars = Bars(indices=[[0, 1]], stiffness=[100.0], rest_length=[1.0])
    >>> body = Geometry(positions=[[0, 0, 0], [1, 0, 0]], masses=[1, 1], fixed=[1, 0], bars=bars)
    >>> scene = Experiment(geometry=body, duration=1.0, dt=0.05, save_interval=0.1)
    >>> {item.producer: item.state for item in producer_verdicts(scene)}["demlat"]
    'runs'
    """
    registry = registry or default_registry()
    runners = [item for item in registry.producers if "run" in item.spec.capabilities]
    names = [item.name for item in runners]
    asked = [
        _verdict(
            experiment,
            item,
            registry,
            name=item.name if names.count(item.name) == 1 else item.qualified_name,
        )
        for item in runners
    ]
    return (*asked, *_broken_plugins(registry))


def _verdict(
    experiment: Experiment, item: Registered, registry: Registry, *, name: str
) -> ProducerVerdict:
    absent = missing_packages(item.spec, "run")
    if absent:
        install = item.spec.install or f"pip install {' '.join(absent)}"
        return ProducerVerdict(
            producer=name,
            state="unavailable",
            text=f"{', '.join(absent)} is not installed: {install}",
        )
    try:
        runner = registry.load(item, capability="run")
        with owned_by(item.qualified_name, "looking at the scene"):
            findings = _findings(runner, experiment)
            modelled = _modelled(runner, experiment, findings)
    except MissingDependency as error:
        return ProducerVerdict(
            producer=name, state="unavailable", text=f"{error.found}: {error.fix}"
        )
    except PluginError as error:
        return ProducerVerdict(producer=name, state="broken", text=f"{error.found}; {error.fix}")
    except OpenPRCError as error:  # the scene contradicts itself, in the eyes of that producer
        finding = Finding(
            code=type(error).__name__,
            level="error",
            path=error.key or "geometry",
            found=error.found,
            expected=error.expected,
            fix=error.fix,
        )
        return ProducerVerdict(
            producer=name, state="refuses", findings=(finding,), text=error.found
        )
    errors = [finding for finding in findings if finding.level == "error"]
    if errors:
        more = f", and {len(errors) - 1} more" if len(errors) > 1 else ""
        text = f"{errors[0].found}{more}"
    else:
        text = "; ".join(finding.found for finding in findings)
    return ProducerVerdict(
        producer=name,
        state="refuses" if errors else "runs",
        findings=findings,
        leaves_out=modelled.leaves_out,
        adds=modelled.adds,
        text=text,
    )


def _findings(runner: Runner, experiment: Experiment) -> tuple[Finding, ...]:
    findings = tuple(runner.supports(experiment))
    for finding in findings:
        if not isinstance(finding, Finding):
            raise TypeError(f"supports() returned a {type(finding).__name__}, not a Finding")
    return findings


def _modelled(runner: Any, experiment: Experiment, findings: Sequence[Finding]) -> Modelled:
    if isinstance(runner, Describer):
        modelled = runner.models(experiment)
        if not isinstance(modelled, Modelled):
            raise TypeError(f"models() returned a {type(modelled).__name__}, not a Modelled")
        return modelled
    # A runner that says nothing more has said it by its warnings.
    return Modelled(leaves_out=tuple(f.found for f in findings if f.level == "warning"))


def _broken_plugins(registry: Registry) -> Iterator[ProducerVerdict]:
    for plugin in registry.plugins:
        if plugin.state in ("broken", "incompatible"):
            yield ProducerVerdict(
                producer=plugin.name,
                state="broken",
                text=f"the plugin could not be loaded: {plugin.problem}; {plugin.fix}",
            )


__all__ = [
    "Physics",
    "ProducerVerdict",
    "State",
    "elements_of",
    "physics_of",
    "producer_verdicts",
]
