"""Stiffness of bars and hinges as MERLIN's constants: C0, A, and moments per length of crease."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import UnitError, UnsupportedScene
from openprc.schema import UNITS
from openprc_merlin.exporter_mesh import Mesh

if TYPE_CHECKING:
    from openprc.schema import Trajectory

Floats = NDArray[np.float64]
#: Laws that MERLIN has; a linear bar has the tangent of its Ogden bar at rest.
_BAR_LAWS = frozenset({"linear", "ogden"})
_HINGE_LAWS = frozenset({"linear", "enhanced-linear", "four-thirds"})
_UNIFORM = 1e-9


@dataclass(frozen=True)
class Laws:
    """Constants in the units of the workspace; None where the trajectory does not tell them.

    Attributes
    ----------
    c0 : modulus of the bars
    area : (M,)
    stiffness : (H,) moment per radian (per rad^(4/3) for bends of that law) and length of crease
    rest_angle : (H,) [rad]
    limits : ends of the linear range of the folds [deg]; (0, 360) where nothing limits it
    four_thirds : whether bends follow the 4/3-power law
    notes : what a reader should know
    """

    c0: float | None
    area: Floats | None
    stiffness: Floats | None
    rest_angle: Floats | None
    limits: tuple[float, float] | None
    four_thirds: bool
    notes: tuple[str, ...]


@dataclass(frozen=True)
class Scale:
    """Units of the workspace: what a number of the trajectory is divided by.

    Attributes
    ----------
    length, force : symbols; "arb" where they are not known
    """

    length: str
    force: str

    def convert(self, values: Floats, unit: str, *, length: int, force: int, key: str) -> Floats:
        """Return `values` [unit] in force^`force` length^`length` of the workspace.

        Arbitrary numbers are taken as they are: they belong to the unit of the run.

        Raises
        ------
        UnitError
            When the unit of length has no factor to SI, and that of the values has.
        """
        if unit in ("arb", "1"):
            return values
        base = UNITS[self.length].si_factor ** length * UNITS[self.force].si_factor ** force
        factor = UNITS[unit].si_factor / base
        if not math.isfinite(factor):
            raise UnitError(
                f"values in {unit!r} beside lengths in {self.length!r}",
                expected="lengths in a unit of length",
                fix="import the run again with its unit",
                key=key,
            )
        return values if factor == 1.0 else values * factor


def scale_of(trajectory: Trajectory) -> Scale:
    """Return the unit of the positions, and that of the recorded forces, else N."""
    force = "N"
    for path in ("/extensions/openprc-merlin/reference_load", "/time_series/channels/reaction"):
        if trajectory.has(path):
            force = trajectory.unit(path)
    return Scale(trajectory.position_unit, force)


def collect(trajectory: Trajectory, mesh: Mesh, scale: Scale) -> Laws:
    """Translate the constants of the elements.

    Raises
    ------
    UnsupportedScene
        When an element follows a law that MERLIN does not have.
    """
    _refuse_foreign(trajectory)
    notes: list[str] = []
    c0, area = _bars(trajectory, mesh, scale, notes)
    stiffness = rest = None
    four_thirds = False
    if len(mesh.hinges):
        stiffness, four_thirds = _hinges(trajectory, mesh, scale, notes)
        rest = _static(trajectory, "hinges", "rest_angle", mesh.hinge_rows)
        if rest is None:
            notes.append("the rest angles are not known: pf0 and pb0 are left out")
    limits = None if stiffness is None else _limits(trajectory, notes)
    return Laws(c0, area, stiffness, rest, limits, four_thirds, tuple(notes))


def _static(trajectory: Trajectory, kind: str, name: str, rows: NDArray[np.int64]) -> Any:
    if not trajectory.has(f"/topology/{kind}/{name}"):
        return None
    return trajectory.element_static(kind, name)[rows]


def _measured(
    trajectory: Trajectory,
    scale: Scale,
    rows: NDArray[np.int64],
    path: tuple[str, str],
    powers: tuple[int, int],
) -> Floats | None:
    """Return a constant of the elements in units of the workspace, powers of length and force."""
    values = _static(trajectory, *path, rows)
    if values is None:
        return None
    key = "/topology/" + "/".join(path)
    unit = trajectory.unit(key)
    values = np.asarray(values, dtype=np.float64)
    return scale.convert(values, unit, length=powers[0], force=powers[1], key=key)


def _refuse_foreign(trajectory: Trajectory) -> None:
    for kind, known in (("bars", _BAR_LAWS), ("hinges", _HINGE_LAWS)):
        base = f"/topology/{kind}"
        stray: set[str] = set()
        if trajectory.has(f"{base}/law"):
            laws = trajectory.element_static(kind, "law")
            stray = {str(law) for law in laws} - known
        if trajectory.has(f"{base}/rigid") and trajectory.element_static(kind, "rigid").any():
            stray.add("rigid")
        if stray:
            raise UnsupportedScene(
                f"{kind} of the kind {', '.join(sorted(stray))}",
                expected=f"elastic {kind}: {', '.join(sorted(known))}",
                fix="give them a stiffness and a law that MERLIN has, and run again",
                file=trajectory.path,
                key=base,
            )


def _bars(
    trajectory: Trajectory, mesh: Mesh, scale: Scale, notes: list[str]
) -> tuple[float | None, Floats | None]:
    """Return C0 and areas: C0 A = k L, the tangent of the Ogden law at rest."""
    rows = mesh.bar_rows
    area = _measured(trajectory, scale, rows, ("bars", "area"), (2, 0))
    stiffness = _measured(trajectory, scale, rows, ("bars", "stiffness"), (-1, 1))
    if stiffness is None:
        known = "C0" if area is not None else "C0 and A"
        notes.append(f"the stiffness of the bars is not known: {known} left out")
        return None, area
    product = stiffness * mesh.length
    if area is None:
        notes.append("C0 is 1 and A is k L: only their product enters")
        return 1.0, product
    moduli = product / np.where(area > 0, area, np.nan)
    c0 = float(np.median(moduli))
    if not np.abs(moduli - c0).max() <= _UNIFORM * abs(c0):
        notes.append("C0 is 1 and A is k L, as the bars differ in C0: only the product enters")
        return 1.0, product
    return c0, area


def _hinges(
    trajectory: Trajectory, mesh: Mesh, scale: Scale, notes: list[str]
) -> tuple[Floats | None, bool]:
    rows, crease = mesh.hinge_rows, mesh.length[: len(mesh.hinges)]
    moment = _measured(trajectory, scale, rows, ("hinges", "stiffness"), (1, 1))
    bends = slice(0, mesh.n_bends)
    power = np.ones(len(rows))
    if moment is None:
        moment = _measured(trajectory, scale, rows, ("hinges", "moment_coefficient"), (1, 1))
        exponents = _static(trajectory, "hinges", "moment_exponent", rows)
        power = power if exponents is None else exponents
    if trajectory.has("/topology/hinges/law"):
        named = np.array(_laws_of_hinges(trajectory))[rows]
        power = np.where(named == "four-thirds", 4 / 3, 1.0)
    if moment is None:
        notes.append("the stiffness of the hinges is not known: it is left out")
        return None, False
    curved = np.abs(power - 4 / 3) < _UNIFORM
    straight = np.abs(power - 1.0) < _UNIFORM
    mixed = curved[bends].any() and not curved[bends].all()
    if mixed or curved[mesh.n_bends :].any() or not (curved | straight).all():
        raise UnsupportedScene(
            "hinges that follow other laws than their kind does in MERLIN",
            expected="folds that are linear, and bends that are all linear or all four-thirds",
            fix="give the hinges these laws and run again",
            file=trajectory.path,
            key="/topology/hinges",
        )
    return moment / crease, bool(curved[bends].any())


def _laws_of_hinges(trajectory: Trajectory) -> list[str]:
    """Return the law of every hinge; linear ones are not named where all of them are."""
    if not trajectory.has("/topology/hinges/law"):
        return ["linear"] * len(trajectory.indices("hinges"))
    return [str(law) for law in trajectory.element_static("hinges", "law")]


def _limits(trajectory: Trajectory, notes: list[str]) -> tuple[float, float] | None:
    """Return the linear range of the hinges [deg], or None where it is not known."""
    if trajectory.has("/extensions/openprc-merlin/limits"):
        low, high = (float(value) for value in trajectory.extension("openprc-merlin", "limits"))
        return low, high
    if trajectory.has("/extensions/openprc-merlin/solver"):
        notes.append("the limits of the linear range of the hinges are not known")
        return None
    if not trajectory.has("/topology/hinges/limit_low"):
        return 0.0, 360.0
    ranged = np.array([law != "four-thirds" for law in _laws_of_hinges(trajectory)], dtype=bool)
    lower, upper = (
        np.unique(np.rad2deg(trajectory.element_static("hinges", name)[ranged]))
        for name in ("limit_low", "limit_high")
    )
    if not ranged.any():
        return 0.0, 360.0
    if len(lower) > 1 or len(upper) > 1:
        notes.append("the hinges differ in their limits, and MERLIN has one pair: the widest")
    # Degrees come back from radians with a last digit of their own.
    return round(float(lower[0]), 9), round(float(upper[-1]), 9)
