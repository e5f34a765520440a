"""What a workspace tells about its constitutive laws.

MERLIN keeps the laws in function handles; their constants survive, if at all, in the text of
the handles, in script variables, or in the stored stresses.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from openprc_merlin.mat5 import FunctionHandle
from openprc_merlin.workspace import Workspace

Floats = NDArray[np.float64]
#: Limits of the linear range that MERLIN2 sets when it chooses the material itself [deg].
AUTOMATIC_LIMITS = (45.0, 315.0)
_OGDEN = re.compile(r"Ogden\s*\(\s*\w+\s*,\s*([^),\s]+)")
_LIMITS = re.compile(r"EnhancedLinear\s*\((?:[^,()]*,){4}\s*([^,()\s]+)\s*,\s*([^,()\s]+)\s*\)")


@dataclass(frozen=True)
class Material:
    """Constants of the laws, and where each was found.

    Attributes
    ----------
    c0 : modulus of the Ogden bars, or None
    c0_source : where it comes from, "" when it is not known
    limits : (lower, upper) end of the linear range of the folds [deg], or None
    limits_source : where they come from
    bend_law : "linear" with the same limits, "four-thirds" (moment ~ angle^(4/3)), or None
    """

    c0: float | None
    c0_source: str
    limits: tuple[float, float] | None
    limits_source: str
    bend_law: Literal["linear", "four-thirds"] | None


def infer(workspace: Workspace, *, c0: float | None = None) -> Material:
    """Collect the constants; an explicit `c0` wins over everything in the file."""
    variables = workspace.variables
    bar_handles = list(_handles(variables, ("truss", "CM"), ("BarMater",), _setting("BarCM")))
    fold_handles = list(
        _handles(
            variables,
            ("angles", "CMfold"),
            ("angles", "CM"),
            ("RotSpring",),
            _setting("RotSprFold"),
        )
    )
    bend_handles = list(
        _handles(
            variables,
            ("angles", "CMbend"),
            ("angles", "CM"),
            ("RotSpring",),
            _setting("RotSprBend"),
        )
    )
    modulus, source = (c0, "the option c0") if c0 is not None else _modulus(variables, bar_handles)
    automatic = str(_dig(variables, _setting("MaterCalib")) or "").lower() == "auto"
    limits, limits_source = _limits(variables, fold_handles, automatic=automatic)
    law: Literal["linear", "four-thirds"] | None = None
    if any("superlinear" in text.lower() for text in bend_handles):
        law = "four-thirds"
    elif workspace.solver == 1 or any("EnhancedLinear" in text for text in bend_handles):
        law = "linear"
    elif automatic:
        law = "four-thirds"
    return Material(modulus, source, limits, limits_source, law)


def _setting(name: str) -> tuple[str, str]:
    return ("AnalyInputOpt", name)


def _dig(variables: Mapping[str, Any], path: tuple[str, ...]) -> Any:
    value: Any = variables
    for key in path:
        if not isinstance(value, Mapping):
            return None
        value = value.get(key)
    return value


def _handles(variables: Mapping[str, Any], *paths: tuple[str, ...]) -> Iterator[str]:
    for path in paths:
        value = _dig(variables, path)
        if isinstance(value, FunctionHandle) and value.text:
            yield value.text
        elif isinstance(value, str) and value.startswith("@("):
            # What could not be saved as a handle is saved as its text, for str2func.
            yield value


def _number(variables: Mapping[str, Any], word: str) -> float | None:
    """Read a constant in the text of a handle: a literal, or the name of a variable."""
    try:
        return float(word)
    except ValueError:
        value = variables.get(word)
    if isinstance(value, np.ndarray) and value.size == 1 and np.isfinite(value).all():
        return float(value.real.ravel()[0])
    return None


def _modulus(variables: Mapping[str, Any], handles: list[str]) -> tuple[float | None, str]:
    """Find C0: from the stored stresses, the handle, a script variable, the settings."""
    strain = _dig(variables, ("STAT", "bar", "Ex"))
    strain = _dig(variables, ("Data", "Exbar")) if strain is None else strain
    stress = _dig(variables, ("STAT", "bar", "Sx"))
    if isinstance(strain, np.ndarray) and isinstance(stress, np.ndarray):
        fitted = fit_modulus(strain, stress)
        if fitted is not None:
            return fitted, "the stored stresses"
    for text in handles:
        found = _OGDEN.search(text)
        value = _number(variables, found.group(1)) if found else None
        if value is not None:
            return value, f"the handle {text!r}"
    named = {name: _number(variables, name) for name in ("C0", "E0") if name in variables}
    values = {value for value in named.values() if value is not None}
    if len(values) == 1:
        return values.pop(), f"the variable {' and '.join(named)}"
    modulus = _dig(variables, _setting("ModElastic"))
    if isinstance(modulus, np.ndarray) and modulus.size == 1:
        return float(modulus.real.ravel()[0]), "AnalyInputOpt.ModElastic"
    return None, ""


def fit_modulus(strain: NDArray[Any], stress: NDArray[Any]) -> float | None:
    """Return C0 such that S = C0/4 (l^3 - 1/l), l = sqrt(1 + 2 E), or None if the law differs.

    Ogden bars with exponents 5 and 1: W = C0/4 ((l^5 - 1)/5 - (l - 1)), Liu & Paulino (2017),
    doi:10.1098/rspa.2017.0348.

    Parameters
    ----------
    strain : Green-Lagrange strain E of every bar and increment
    stress : second Piola-Kirchhoff stress S, same shape
    """
    if strain.shape != stress.shape or not strain.size or strain.dtype.kind == "c":
        return None
    plausible = (np.abs(strain) < 1e6).all() and (np.abs(stress) < 1e60).all()
    if not plausible or strain.min() <= -0.5:
        return None
    stretch = np.sqrt(1 + 2 * strain)
    shape = (stretch**3 - 1 / stretch) / 4
    power = float((shape**2).sum())
    if power == 0.0:
        return None
    c0 = float((shape * stress).sum() / power)
    misfit = np.abs(stress - c0 * shape).max()
    return c0 if misfit <= 1e-6 * np.abs(stress).max() else None


def _limits(
    variables: Mapping[str, Any], handles: list[str], *, automatic: bool
) -> tuple[tuple[float, float] | None, str]:
    for text in handles:
        found = _LIMITS.search(text)
        if found:
            low, high = (_number(variables, word) for word in found.groups())
            if low is not None and high is not None:
                return (low, high), f"the handle {text!r}"
    low, high = (_number(variables, name) for name in ("limlft", "limrht"))
    if low is not None and high is not None:
        return (low, high), "limlft and limrht"
    return (AUTOMATIC_LIMITS, "MERLIN2's automatic choice") if automatic else (None, "")
