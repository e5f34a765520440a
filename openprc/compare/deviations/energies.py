"""Energies of both files: how much each drifts, and how far they are apart."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.schema import units

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.compare.alignment.common_clock import CommonClock
    from openprc.schema.trajectory import Trajectory

    Reals = NDArray[np.float64]

#: Whole-body quantities that both files may have, to be compared one by one.
COMPARED = ("kinetic_energy", "potential_energy", "total_energy")
MASS = "/topology/nodes/mass"
VELOCITIES = "/time_series/nodes/velocities"
BLOCK_BYTES = 2 << 20


@dataclass(frozen=True)
class EnergyDrift:
    """How well a file keeps its energy.

    Parameters
    ----------
    of : str
        What should stay: "total_energy", or that less the work done on the body and plus what
        it dissipated, where both are stored. Where a body is driven and they are not, its
        energy need not stay, and this says so.
    first, last : float [J]
    largest : float [J]
        Largest deviation from the first value.
    scale : float [J]
        Largest kinetic energy; largest total where none is known.
    """

    of: str
    first: float
    last: float
    largest: float
    scale: float

    @property
    def relative(self) -> float | None:
        """Largest deviation in units of the scale."""
        return self.largest / self.scale if self.scale > 0 else None

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON output."""
        return {**self.__dict__, "relative": self.relative}


@dataclass(frozen=True)
class EnergyDifference:
    """One energy in both files, at the common instants.

    Parameters
    ----------
    name : str
    rms, largest : float [J]
    relative : float or None
        `rms` over the largest absolute value in the reference.
    computed : tuple of str
        Files ("reference", "other") that did not store it: kinetic energy from masses and
        velocities.
    """

    name: str
    rms: float
    largest: float
    relative: float | None
    computed: tuple[str, ...] = ()

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON output."""
        return {**self.__dict__, "computed": list(self.computed)}


@dataclass(frozen=True)
class PairEnergies:
    """Energies of a pair: drifts (None where a file has none) and differences."""

    reference: EnergyDrift | None
    other: EnergyDrift | None
    differences: tuple[EnergyDifference, ...]

    def as_dict(self) -> dict[str, Any]:
        """Return plain values, for JSON output."""
        return {
            "reference": None if self.reference is None else self.reference.as_dict(),
            "other": None if self.other is None else self.other.as_dict(),
            "differences": [item.as_dict() for item in self.differences],
        }


def pair_energies(
    reference: Trajectory, other: Trajectory, clock: CommonClock
) -> PairEnergies | None:
    """Return the energies of a pair, None where neither file has any.

    A kinetic energy that is not stored is computed from masses and velocities, where the other
    file has one to compare with.
    """
    stored = tuple(_stored(trajectory) for trajectory in (reference, other))
    computed = []
    files = (("reference", reference), ("other", other))
    if all(
        "kinetic_energy" in energies or _has_kinetic(trajectory)
        for (_, trajectory), energies in zip(files, stored, strict=True)
    ):
        # Worth reading all velocities only where there is something to compare with.
        for (name, trajectory), energies in zip(files, stored, strict=True):
            if "kinetic_energy" not in energies:
                energies["kinetic_energy"] = kinetic_energy(trajectory)
                computed.append(name)
    if not any(stored):
        return None
    differences = []
    for name in COMPARED:
        if all(name in energies for energies in stored):
            at = [
                _at(energies[name], sampling)
                for energies, sampling in zip(stored, (clock.reference, clock.other), strict=True)
            ]
            apart = np.abs(at[0] - at[1])
            scale = float(np.abs(at[0]).max())
            differences.append(
                EnergyDifference(
                    name,
                    float(np.sqrt(np.mean(apart**2))),
                    float(apart.max()),
                    float(np.sqrt(np.mean(apart**2))) / scale if scale > 0 else None,
                    tuple(computed) if name == "kinetic_energy" else (),
                )
            )
    return PairEnergies(
        _drift(stored[0], driven=bool(reference.inputs)),
        _drift(stored[1], driven=bool(other.inputs)),
        tuple(differences),
    )


def _stored(trajectory: Trajectory) -> dict[str, Reals]:
    """Return the whole-body energies of a file [J]."""
    found = {}
    for name in (*COMPARED, "work_in", "dissipated"):
        path = f"/time_series/system/{name}"
        if name in trajectory.systems and units.unit(trajectory.unit(path)).dimension == "energy":
            series = trajectory.system(name, unit="J")
            if np.isfinite(series).all():
                found[name] = series
    if "total_energy" not in found and {"kinetic_energy", "potential_energy"} <= set(found):
        found["total_energy"] = found["kinetic_energy"] + found["potential_energy"]
    return found


def _drift(energies: dict[str, Reals], *, driven: bool) -> EnergyDrift | None:
    if "total_energy" not in energies:
        return None
    kept, of = energies["total_energy"], "total_energy"
    if "work_in" in energies and "dissipated" in energies:
        kept = kept - energies["work_in"] + energies["dissipated"]
        of = "total_energy - work_in + dissipated"
    elif driven:
        of = "total_energy of a driven body"
    kinetic = energies.get("kinetic_energy")
    scale = 0.0 if kinetic is None else float(kinetic.max())
    scale = scale or float(np.abs(energies["total_energy"]).max())
    return EnergyDrift(
        of, float(kept[0]), float(kept[-1]), float(np.abs(kept - kept[0]).max()), scale
    )


def _has_kinetic(trajectory: Trajectory) -> bool:
    if not (trajectory.has(MASS) and trajectory.has(VELOCITIES)):
        return False
    return (
        units.unit(trajectory.unit(MASS)).dimension == "mass"
        and units.unit(trajectory.unit(VELOCITIES)).dimension == "velocity"
    )


def kinetic_energy(trajectory: Trajectory) -> Reals:
    """Return ``sum_i m_i |v_i|^2 / 2`` of every frame: (T,) [J]; missing nodes count as at rest.

    Parameters
    ----------
    trajectory : Trajectory
        With masses and velocities.
    """
    mass = trajectory.node("mass").astype("f8") * units.unit(trajectory.unit(MASS)).si_factor
    step = max(1, BLOCK_BYTES // (trajectory.n_nodes * trajectory.dims * 8))
    energy = np.empty(trajectory.n_frames)
    for start in range(0, trajectory.n_frames, step):
        v = np.nan_to_num(trajectory.velocities(slice(start, start + step), unit="m/s"))
        energy[start : start + len(v)] = 0.5 * (np.einsum("tnd,tnd->tn", v, v) @ mass)
    return energy


def _at(series: Reals, sampling: Any) -> Reals:
    """Return a whole-body quantity at the common instants, by cubic interpolation if need be."""
    from openprc.compare.alignment.interpolants import WIDTHS, sum_frames, weights_at  # noqa: PLC0415 - numba

    if sampling.exact:
        return series[sampling.frames]
    name = "cubic" if len(series) >= WIDTHS["cubic"] else "linear"
    weights = weights_at(sampling.clock, sampling.instants, name=name)
    return sum_frames(weights, series[:, np.newaxis, np.newaxis])[:, 0, 0]


__all__ = ["EnergyDifference", "EnergyDrift", "PairEnergies", "kinetic_energy", "pair_energies"]
