"""From a chain of bars and bends to the numbers of a rod.

A rod of n elements of length l carries tension ``EA (e - 1) / e`` at the stretch e, since its
section thins, and for the same reason the couple ``EI / (l e^3)`` times the angle between
neighbouring elements (Gazzola et al. 2018, doi:10.1098/rsos.171628); its nodes have the mass
``rho A l``, half of it at the ends. A chain of bars of stiffness k with bends of stiffness k_b is
the same body with

    EA = k l,   EI = k_b l,   rho A = m / l,   R = 2 sqrt(EI / EA)

as far as strains are small. Every element has numbers of its own, so chains need not be uniform
and masses may be those of points. What a rod has besides, and a chain has not: shear stiffness
``a G A`` (a = 27/28), twist stiffness, and rotary inertia ``m R^2 / 4`` of its elements.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.errors import ConfigError
from openprc_pyelastica.wave_speeds import SHEAR_FACTOR

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema import Experiment
    from openprc_pyelastica.chains import Chain

#: Radius of elements that nothing resists the bending of, as a share of their length.
THIN = 0.1


@dataclass(frozen=True, eq=False)
class RodMaterial:
    """What a rod of n elements is made of.

    Parameters
    ----------
    rest_lengths : (n,) [m]
    mass : (n + 1,) [kg]
        Of the nodes.
    stretch, shear : (n,) [N]
        EA, and a G A.
    bend, twist : (n - 1,) [N*m2]
        EI, and G I_3, at the inner nodes.
    radius : float [m]
    inertia : (n,) [kg*m2]
        Of an element about an axis across it.
    """

    rest_lengths: NDArray[np.float64]
    mass: NDArray[np.float64]
    stretch: NDArray[np.float64]
    shear: NDArray[np.float64]
    bend: NDArray[np.float64]
    twist: NDArray[np.float64]
    radius: float
    inertia: NDArray[np.float64]

    @property
    def vertex_lengths(self) -> NDArray[np.float64]:
        """Half of either neighbour, at the inner nodes: (n - 1,) [m]."""
        return 0.5 * (self.rest_lengths[1:] + self.rest_lengths[:-1])

    @property
    def shear_share(self) -> float:
        """Deflection by shear over that by bending, of a cantilever loaded at its end.

        ``3 EI / (a G A L^2)``, Timoshenko's beam; infinite where nothing resists bending.
        """
        if not self.bend.any():
            return math.inf
        length = float(self.rest_lengths.sum())
        return 3.0 * float(self.bend.mean()) / (float(self.shear.mean()) * length**2)


def checked_options(options: Mapping[str, Any]) -> dict[str, Any]:
    """Return the options of a run with their meaning checked.

    Raises
    ------
    ConfigError
    """
    values = {
        "poisson": 0.5,
        "shear_scale": 1.0,
        "radius": None,
        "section": "thinning",
        "clamp": "element",
        "substeps": "1",
    } | dict(options)
    if not -1.0 < values["poisson"] <= 0.5:
        raise _wrong("poisson", values["poisson"], "a ratio above -1 and up to 0.5", "0.5")
    if not 0.0 < values["shear_scale"] < math.inf:
        raise _wrong("shear_scale", values["shear_scale"], "a factor above 0", "1")
    if values["radius"] is not None and not 0.0 < values["radius"] < math.inf:
        raise _wrong("radius", values["radius"], "a length above 0 m", "2 sqrt(EI/EA)")
    substeps = str(values["substeps"])
    if substeps != "auto" and not (substeps.isdecimal() and int(substeps) > 0):
        raise _wrong("substeps", substeps, "a whole number above 0, or auto", "1")
    values["substeps"] = substeps if substeps == "auto" else int(substeps)
    return values


def _wrong(key: str, found: object, expected: str, default: str) -> ConfigError:
    return ConfigError(
        f"option {key} is {found!r}",
        expected=expected,
        fix=f"leave it out for {default}",
        key=key,
    )


def material_of(chain: Chain, experiment: Experiment, *, options: Mapping[str, Any]) -> RodMaterial:
    """Return what the rod of a chain is made of.

    Parameters
    ----------
    chain : Chain
    experiment : Experiment
    options : mapping
        As `checked_options` returns them.
    """
    geometry = experiment.geometry
    rest = geometry.bars.relaxed_length[chain.bars]
    stretch = geometry.bars.stiffness[chain.bars] * rest
    vertex = 0.5 * (rest[1:] + rest[:-1])
    bend = chain.bend * vertex
    mass = np.array(geometry.masses[chain.nodes])
    # A node without mass is held, and its mass then plays no role.
    mass[mass == 0.0] = mass[mass > 0.0].mean() if mass.any() else 1.0
    if options["radius"] is not None:
        radius = float(options["radius"])
    elif bend.any():
        radius = 2.0 * math.sqrt(bend.mean() / stretch.mean())
    else:
        radius = THIN * float(rest.min())
    modulus_ratio = 1.0 / (2.0 * (1.0 + options["poisson"]))  # G / E
    shares = np.ones(len(mass))
    shares[[0, -1]] = 2.0  # only half an element ends there
    whole = shares * mass
    element_mass = 0.5 * (whole[1:] + whole[:-1])
    return RodMaterial(
        rest_lengths=rest,
        mass=mass,
        stretch=stretch,
        shear=SHEAR_FACTOR * modulus_ratio * options["shear_scale"] * stretch,
        bend=bend,
        twist=2.0 * modulus_ratio * bend,
        radius=radius,
        inertia=0.25 * element_mass * radius**2,
    )
