"""Elastic laws of bars and hinges over whole columns: energy, force and tangent.

A bar's coordinate is its length [m], a hinge's its bend [rad], the dihedral angle minus pi.
Rigid elements have no law; their coordinate is a constraint.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema.geometry import Bars, Hinges

    Reals = NDArray[np.float64]


class BarLaws:
    """The laws of `openprc.schema.geometry.Bars`, springs only.

    Parameters
    ----------
    bars : Bars
    """

    def __init__(self, bars: Bars) -> None:
        self.relaxed = bars.relaxed_length
        self.stiffness = np.where(bars.rigid, 0.0, bars.stiffness)
        self.cubic = np.where(bars.rigid | (bars.law != "cubic"), 0.0, bars.stiffness_cubic)
        self._cable = bars.law == "cable"
        self._strut = bars.law == "strut"
        self._ogden = np.flatnonzero((bars.law == "ogden") & ~bars.rigid)

    def _stretch(self, lengths: Reals) -> Reals:
        """Return ``l - relaxed``, and 0 where the bar is slack: (M,) [m]."""
        stretch = lengths - self.relaxed
        slack = (self._cable & (stretch <= 0.0)) | (self._strut & (stretch >= 0.0))
        result: Reals = np.where(slack, 0.0, stretch)
        return result

    def energy(self, lengths: Reals) -> Reals:
        """Return elastic energies at `lengths` (M,) [m]: (M,) [J]."""
        square = self._stretch(lengths) ** 2
        energy: Reals = 0.5 * self.stiffness * square + 0.25 * self.cubic * square**2
        o = self._ogden
        if len(o):
            # (1+e)^5/5 - (1+e) + 4/5, expanded in e so that small strains keep their digits.
            e = lengths[o] / self.relaxed[o] - 1.0
            shape = e**2 * (2.0 + 2.0 * e + e**2 + e**3 / 5.0)
            energy[o] = 0.25 * self.stiffness[o] * self.relaxed[o] ** 2 * shape
        return energy

    def force(self, lengths: Reals) -> Reals:
        """Return tensions at `lengths` (M,) [m]: (M,) [N], positive when pulling."""
        stretch = self._stretch(lengths)
        force: Reals = self.stiffness * stretch + self.cubic * stretch**3
        o = self._ogden
        if len(o):
            e = lengths[o] / self.relaxed[o] - 1.0
            shape = e * (1.0 + 1.5 * e + e**2 + 0.25 * e**3)
            force[o] = self.stiffness[o] * self.relaxed[o] * shape
        return force

    def tangent(self, lengths: Reals) -> Reals:
        """Return d(tension)/d(length) at `lengths` (M,) [m]: (M,) [N/m]."""
        stretch = lengths - self.relaxed
        slack = (self._cable & (stretch <= 0.0)) | (self._strut & (stretch >= 0.0))
        tangent: Reals = np.where(slack, 0.0, self.stiffness + 3.0 * self.cubic * stretch**2)
        o = self._ogden
        if len(o):
            tangent[o] = self.stiffness[o] * (lengths[o] / self.relaxed[o]) ** 3
        return tangent


class HingeLaws:
    """The laws of `openprc.schema.geometry.Hinges`, springs only.

    "enhanced-linear" beyond its limits is Liu & Paulino 2017, doi:10.1098/rspa.2017.0348: the
    linear moment at the limit plus ``k (2 w / pi) tan(pi (angle - limit) / (2 w))``, where w is
    the angle between the limit and folded shut. "four-thirds" is the bending of a panel in
    Liu & Paulino 2018 (Origami 7): ``k sign(d) |d|^(4/3)``, without stiffness where d = 0.

    Parameters
    ----------
    hinges : Hinges
    """

    def __init__(self, hinges: Hinges) -> None:
        self.stiffness = np.where(hinges.rigid, 0.0, hinges.stiffness)
        self.rest = hinges.rest_angle - np.pi
        self.enhanced = (hinges.law == "enhanced-linear") & ~hinges.rigid
        self._low = np.where(self.enhanced, hinges.limit_low - np.pi, -np.inf)
        self._high = np.where(self.enhanced, hinges.limit_high - np.pi, np.inf)
        self._power = np.flatnonzero((hinges.law == "four-thirds") & ~hinges.rigid)

    def difference(self, bends: Reals) -> Reals:
        """Return ``bend - rest`` (K,) [rad], the shorter way round unless there are limits."""
        difference = bends - self.rest
        turns = np.floor(difference / (2.0 * np.pi) + 0.5)
        result: Reals = np.where(self.enhanced, difference, difference - 2.0 * np.pi * turns)
        return result

    def _beyond(self, bends: Reals) -> tuple[NDArray[np.int64], Reals, Reals, Reals]:
        """Return the hinges past a limit, that limit, w / (pi / 2), and the tan's argument."""
        past = np.flatnonzero((bends < self._low) | (bends > self._high))
        limit = np.where(bends[past] < self._low[past], self._low[past], self._high[past])
        width = (np.pi - np.abs(limit)) * (2.0 / np.pi)
        return past, limit, width, (bends[past] - limit) / width

    def energy(self, bends: Reals) -> Reals:
        """Return elastic energies at `bends` (K,) [rad]: (K,) [J]."""
        difference = self.difference(bends)
        energy: Reals = 0.5 * self.stiffness * difference**2
        p = self._power
        if len(p):
            energy[p] = 3.0 / 7.0 * self.stiffness[p] * np.abs(difference[p]) ** (7.0 / 3.0)
        past, limit, width, u = self._beyond(bends)
        start = limit - self.rest[past]
        grown = 0.5 * start**2 + start * (bends[past] - limit) - width**2 * np.log(np.cos(u))
        energy[past] = self.stiffness[past] * grown
        return energy

    def force(self, bends: Reals) -> Reals:
        """Return moments at `bends` (K,) [rad]: (K,) [N m], positive when they lower it."""
        difference = self.difference(bends)
        moment: Reals = self.stiffness * difference
        p = self._power
        if len(p):
            moment[p] *= np.cbrt(np.abs(difference[p]))
        past, limit, width, u = self._beyond(bends)
        moment[past] = self.stiffness[past] * (limit - self.rest[past] + width * np.tan(u))
        return moment

    def tangent(self, bends: Reals) -> Reals:
        """Return d(moment)/d(angle) at `bends` (K,) [rad]: (K,) [N m/rad]."""
        tangent = self.stiffness.copy()
        p = self._power
        if len(p):
            tangent[p] *= 4.0 / 3.0 * np.cbrt(np.abs(self.difference(bends)[p]))
        past, _, _, u = self._beyond(bends)
        tangent[past] /= np.cos(u) ** 2
        return tangent
