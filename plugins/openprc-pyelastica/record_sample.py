"""Record ``openprc_pyelastica/data/driven_cantilever.npz`` with PyElastica 1.0.

A soft rod hangs from a clamp under gravity and is pushed sideways at its middle node by a random
symbol sequence. One sample is kept for each symbol, one step before its hold ends: a sample on the
border itself would belong to the next symbol as much as to this one.

Run ``python record_sample.py`` in an environment with the extra ``simulator``; it takes about
twenty seconds, and up to a minute more when PyElastica compiles its kernels for the first time.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import elastica as ea  # noqa: TID253 - the script exists to drive the simulator
import numpy as np
from numpy.typing import NDArray

TARGET = Path(__file__).parent / "openprc_pyelastica" / "data" / "driven_cantilever.npz"


@dataclass(frozen=True)
class Setting:
    """What is simulated.

    The step is 0.28 of the shortest of the limits l/c_E, l/c_s and R/c_s, where c_E and c_s are
    the speeds of stretch and shear waves and l is the length of an element.
    """

    length: float = 0.3  # m
    radius: float = 0.01  # m
    density: float = 1000.0  # kg/m3
    youngs_modulus: float = 1e5  # Pa
    poisson_ratio: float = 0.5
    n_elements: int = 10
    damping: float = 4.0  # 1/s, uniform
    gravity: float = 9.80665  # m/s2
    force: float = 0.15  # N: the push is force * 4 (u - 0.25)
    hold: float = 0.2  # s
    steps_per_symbol: int = 400
    n_symbols: int = 600
    seed: int = 1


class _Rod(ea.BaseSystemCollection, ea.Constraints, ea.Forcing, ea.Damping, ea.CallBacks):
    """The features of PyElastica that are used."""


class SymbolForce(ea.NoForces):
    """Pushes the middle node along x, with a force that is constant during each symbol."""

    def __init__(
        self, symbols: NDArray[np.float64], acting: NDArray[np.float64], *, setting: Setting
    ) -> None:
        """Take the (K,) symbols and the (1,) array that tells the callback which one acts."""
        super().__init__()
        self.symbols = symbols
        self.acting = acting
        self.setting = setting

    def apply_forces(self, system: ea.CosseratRod, time: float = 0.0) -> None:
        """Add the force of the symbol that acts at `time`."""
        # The stepper asks in the middle of a step, so that time is never on a symbol's border.
        self.acting[0] = self.symbols[int(np.floor(float(time) / self.setting.hold))]
        push = self.setting.force * 4.0 * (self.acting[0] - 0.25)
        system.external_forces[0, self.setting.n_elements // 2] += push


class EndOfSymbol(ea.CallBackBaseClass):
    """Keeps one sample for each symbol, one step before the next symbol begins."""

    def __init__(
        self,
        acting: NDArray[np.float64],
        samples: dict[str, list[NDArray[np.float64]]],
        *,
        every: int,
    ) -> None:
        """Take the symbol that acts, the lists to fill, and the steps between samples."""
        super().__init__()
        self.acting = acting
        self.samples = samples
        self.every = every

    def make_callback(self, system: ea.CosseratRod, time: float, current_step: int) -> None:
        """Append copies of the state; ``u`` is the symbol that acts."""
        if (current_step + 1) % self.every:
            return
        self.samples["time"].append(np.float64(time))
        self.samples["step"].append(np.int64(current_step))
        self.samples["position"].append(system.position_collection.copy())
        self.samples["velocity"].append(system.velocity_collection.copy())
        self.samples["u"].append(np.float64(self.acting[0]))


def draw_symbols(setting: Setting) -> NDArray[np.float64]:
    """Return the (K,) symbols, independent and uniform on [0, 0.5)."""
    return np.random.default_rng(setting.seed).uniform(0.0, 0.5, setting.n_symbols)


def simulate(setting: Setting, *, n_symbols: int | None = None) -> dict[str, NDArray[np.float64]]:
    """Return the arrays of the recording, for the first `n_symbols` symbols or all of them."""
    symbols = draw_symbols(setting)
    simulator = _Rod()
    rod = ea.CosseratRod.straight_rod(
        setting.n_elements,
        np.zeros(3),
        np.array([0.0, 0.0, -1.0]),
        np.array([0.0, 1.0, 0.0]),
        setting.length,
        setting.radius,
        setting.density,
        youngs_modulus=setting.youngs_modulus,
        shear_modulus=setting.youngs_modulus / (2.0 * (1.0 + setting.poisson_ratio)),
    )
    dt = setting.hold / setting.steps_per_symbol
    simulator.append(rod)
    simulator.constrain(rod).using(
        ea.OneEndFixedBC, constrained_position_idx=(0,), constrained_director_idx=(0,)
    )
    simulator.add_forcing_to(rod).using(
        ea.GravityForces, acc_gravity=np.array([0.0, 0.0, -setting.gravity])
    )
    simulator.dampen(rod).using(
        ea.AnalyticalLinearDamper, uniform_damping_constant=setting.damping, time_step=dt
    )
    acting = symbols[:1].copy()
    simulator.add_forcing_to(rod).using(SymbolForce, symbols, acting, setting=setting)
    names = ("time", "step", "position", "velocity", "u")
    samples: dict[str, list[NDArray[np.float64]]] = {name: [] for name in names}
    simulator.collect_diagnostics(rod).using(
        EndOfSymbol, acting, samples, every=setting.steps_per_symbol
    )
    simulator.finalize()
    stepper = ea.PositionVerlet()
    time = np.float64(0.0)
    for _ in range((n_symbols or setting.n_symbols) * setting.steps_per_symbol):
        time = stepper.step(simulator, time, np.float64(dt))
    constants = {"rest_lengths": rod.rest_lengths.copy(), "mass": rod.mass.copy()}
    return {name: np.array(values) for name, values in samples.items()} | constants


if __name__ == "__main__":
    np.savez_compressed(TARGET, **simulate(Setting()))
