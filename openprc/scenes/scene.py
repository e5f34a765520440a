"""What a scene of the library is: a body in neutral terms, and what is known about its motion."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Literal

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from openprc.hooks.specs import OptionSpec
    from openprc.schema.experiment import Experiment
    from openprc.schema.trajectory import Trajectory

    Reals = NDArray[np.float64]

ReferenceKind = Literal["closed form", "converged", "published"]


@dataclass(frozen=True, kw_only=True)
class Probe:
    """A number that a run of the scene has to give.

    Parameters
    ----------
    name : str
        Such as "fundamental frequency".
    value : float
    unit : str
    tolerance : float
        Largest relative deviation from `value` of a run with the settings of the scene (absolute
        where `value` is 0).
    measure : callable
        Takes an open `Trajectory` of the scene and returns what it says.
    source : str
        Equation or DOI.
    """

    name: str
    value: float
    unit: str
    tolerance: float
    measure: Callable[[Trajectory], float]
    source: str


@dataclass(frozen=True, kw_only=True)
class Reference:
    """What the motion is known to be.

    Parameters
    ----------
    kind : {"closed form", "converged", "published"}
    text : str
        One sentence: what is known, and how well.
    source : str
        Equation or DOI; for "converged" by which scheme and to what.
    exact : callable, optional
        Rising times (T,) [s], from 0 or later, to positions (T, N, 3) [m] of the very scene, in
        the order of its nodes: by a formula, or for "converged" by a solver that integrates up to
        the last of these times when it is called. None where only some numbers are known.
    probes : tuple of Probe
    """

    kind: ReferenceKind
    text: str
    source: str
    exact: Callable[[Reals], Reals] | None = None
    probes: tuple[Probe, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Scene:
    """A body, its drive, and what is known about it.

    Parameters
    ----------
    name : str
    experiment : Experiment
    reference : Reference
    scale : float [m]
        What deviations of positions are measured in: an amplitude, a swing, a fold.
    chaotic : bool
        Runs part exponentially: deviations past the horizon say nothing about a simulator.
    quasi_static : bool
        Meant as a path of equilibria; a run in time follows it slowly.
    input_name : str or None
        The signal that tasks compute with; None where nothing drives the body at random.
    features : str or None
        Name of the registered feature that tasks read; None for the default.
    """

    name: str
    experiment: Experiment
    reference: Reference
    scale: float
    chaotic: bool = False
    quasi_static: bool = False
    input_name: str | None = None
    features: str | None = None


@dataclass(frozen=True, kw_only=True)
class SceneSpec:
    """The record of a scene: enough to list it without building it.

    Parameters
    ----------
    name : str
    summary : str
        One line.
    needs : tuple of str
        The physics that it uses, in the words of `openprc.hooks.specs.ELEMENTS`.
    reference : {"closed form", "converged", "published"}
        What its motion is known by, with the options as they are.
    load : str
        ``"package.module:function"`` of a builder that takes every option as a keyword and
        returns a `Scene`.
    options : tuple of OptionSpec
    run_options : mapping of str to mapping
        Producer to the options of a run (`ProducerSpec.run_options`) with which it comes closest
        to the scene, where its defaults model something else.
    """

    name: str
    summary: str
    needs: tuple[str, ...]
    reference: ReferenceKind
    load: str
    options: tuple[OptionSpec, ...] = ()
    run_options: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)


__all__ = ["Probe", "Reference", "ReferenceKind", "Scene", "SceneSpec"]
