"""`SimulationScaler`: all quantities on one numerical scale before they are integrated."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema.experiment import Experiment


def _power_of_two(value: float) -> float:
    return 2.0 ** round(math.log2(value)) if 0.0 < value < math.inf else 1.0


@dataclass(frozen=True)
class SimulationScaler:
    """Units of length, mass and time in which a scene's numbers are of the order of one.

    Everything else follows from these three, rotational stiffness as well as axial stiffness.
    The units are powers of two, so scaling rounds nothing: in float64 the motion is the same to
    the last bit, in float32 it uses the range that there is.

    Parameters
    ----------
    length : float [m]
    mass : float [kg]
    time : float [s]
    """

    length: float = 1.0
    mass: float = 1.0
    time: float = 1.0

    @classmethod
    def for_experiment(cls, experiment: Experiment) -> SimulationScaler:
        """Return units from the mean bar, the mean mass and the mean stiffness of a scene."""
        geometry = experiment.geometry
        length = _mean(geometry.bars.rest_length)
        if length == 0.0:
            length = float(np.ptp(geometry.positions, axis=0).max(initial=0.0))
        length = _power_of_two(length)
        mass = _power_of_two(_mean(geometry.masses))
        stiffness = _mean(geometry.bars.stiffness[~geometry.bars.rigid])
        if stiffness == 0.0:
            soft = geometry.hinges.stiffness[~geometry.hinges.rigid]
            stiffness = _mean(np.append(soft, geometry.bends.stiffness)) / length**2
        gravity = float(np.linalg.norm(experiment.gravity))
        if stiffness > 0.0:
            time = math.sqrt(mass / stiffness)
        elif gravity > 0.0:
            time = math.sqrt(length / gravity)
        else:
            time = experiment.save_interval
        return cls(length, mass, _power_of_two(time))

    @property
    def velocity(self) -> float:
        """Unit of velocity [m/s]."""
        return self.length / self.time

    @property
    def force(self) -> float:
        """Unit of force [N]."""
        return self.mass * self.length / self.time**2

    @property
    def moment(self) -> float:
        """Unit of moment and of rotational stiffness [N*m], and of energy [J]."""
        return self.force * self.length

    @property
    def stiffness(self) -> float:
        """Unit of axial stiffness [N/m]."""
        return self.mass / self.time**2

    @property
    def damping(self) -> float:
        """Unit of axial damping [N*s/m]."""
        return self.mass / self.time

    @property
    def output(self) -> tuple[float, float, float, float, float]:
        """What saved numbers are multiplied by: length, velocity, force, moment, energy."""
        return self.length, self.velocity, self.force, self.moment, self.moment


def _mean(values: NDArray[np.float64]) -> float:
    positive = values[values > 0.0]
    return float(positive.mean()) if len(positive) else 0.0
