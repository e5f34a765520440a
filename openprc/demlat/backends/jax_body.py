"""Energies of the bar-hinge model in `jax.numpy`, and forces as their derivatives.

Nothing here is shared with the compiled force laws: what differentiates to the same forces is
a check on both. Losses come from Rayleigh's dissipation functions, differentiated with respect
to velocities (Goldstein, Classical Mechanics, sec. 1.5); the printed damping has none, since it
does not act along a length, and is written as forces. Everything is in SI units.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import jax
import jax.numpy as jnp
import numpy as np

from openprc.schema.geometry import BAR_LAWS

if TYPE_CHECKING:
    from openprc.schema.experiment import Experiment

Array = Any
Parameters = Mapping[str, Any]
#: Added to squares before a root is taken, so that derivatives at zero length are finite.
TINY = 1e-36


def parameters_of(experiment: Experiment) -> dict[str, Any]:
    """Return everything that motion can be differentiated with respect to.

    Returns
    -------
    dict of str to array, or to dict of such
        "positions", "velocities" (N, 3) [m], [m/s] at t = 0; "masses" (N,) [kg]; "damping" of
        the whole body; "gravity" (3,) [m/s2]; "bars" and "hinges" with the columns of
        `openprc.schema.geometry`; "signals" by name, (T_u, d).
    """
    geometry = experiment.geometry
    names = ("stiffness", "rest_length", "prestress", "damping", "stiffness_cubic", "damping_cubic")
    return {
        "positions": np.array(geometry.positions),
        "velocities": np.array(geometry.velocities),
        "masses": np.array(geometry.masses),
        "damping": np.float64(experiment.damping),
        "gravity": np.array(experiment.gravity, dtype=np.float64),
        "bars": {name: np.array(getattr(geometry.bars, name)) for name in names},
        "hinges": {
            name: np.array(getattr(geometry.hinges, name))
            for name in ("stiffness", "rest_angle", "damping")
        },
        "signals": {name: np.array(s.values) for name, s in experiment.signals.items()},
    }


class JaxBody:
    """What of a scene is not differentiated: who is connected to whom, and by which law.

    Parameters
    ----------
    experiment : Experiment
    """

    def __init__(self, experiment: Experiment) -> None:
        geometry = experiment.geometry
        bars, hinges = geometry.bars, geometry.hinges
        self.ends = np.array(bars.indices)
        self.corners = np.array(hinges.indices)
        self.of_law = {law: np.flatnonzero(bars.law == law) for law in BAR_LAWS}
        self.printed = experiment.bar_damping == "printed"
        self.has_walls = np.array(hinges.law == "enhanced-linear")
        self.walled = np.flatnonzero(self.has_walls)
        self.limits = np.array([hinges.limit_low, hinges.limit_high])[:, self.walled]
        self.massive = np.array(geometry.masses > 0)
        self.free = ~experiment.held_axes

    # --- geometry ---------------------------------------------------------------------------

    def lengths(self, x: Array) -> Array:
        """Return lengths of bars: (M,) [m]."""
        along = x[self.ends[:, 1]] - x[self.ends[:, 0]]
        return jnp.sqrt(jnp.sum(along * along, axis=1) + TINY)

    def bends(self, x: Array, rest_angle: Array) -> Array:
        """Return angles minus rest angles: (K,) [rad].

        The wings, made perpendicular to the crease, are at the dihedral angle. Turning back by
        the rest angle before the arctangent is taken means the shorter way round; hinges with
        walls cannot go through shut, so they are turned back by pi, where they are flat.
        """
        j, k, i, l = (x[self.corners[:, c]] for c in range(4))  # noqa: E741
        crease = k - j
        along = crease / jnp.sqrt(jnp.sum(crease * crease, axis=1, keepdims=True) + TINY)
        wings = []
        for wing in (i - j, l - k):
            wings.append(wing - jnp.sum(wing * along, axis=1, keepdims=True) * along)
        sine = jnp.sum(along * jnp.cross(wings[0], wings[1]), axis=1)
        cosine = jnp.sum(wings[0] * wings[1], axis=1)
        s = jnp.where(self.has_walls, 0.0, jnp.sin(rest_angle))
        c = jnp.where(self.has_walls, -1.0, jnp.cos(rest_angle))
        turned = jnp.arctan2(sine * c - cosine * s, cosine * c + sine * s)
        return turned - jnp.where(self.has_walls, rest_angle - np.pi, 0.0)

    # --- energies ---------------------------------------------------------------------------

    def bar_energies(self, p: Parameters, stretch: Array) -> Array:
        """Return elastic energies: (M,) [J]."""
        bars = p["bars"]
        relaxed = bars["rest_length"] * (1.0 + bars["prestress"])

        def linear(e: Array, s: Array) -> Array:
            return 0.5 * bars["stiffness"][e] * s**2

        def ogden(e: Array, s: Array) -> Array:
            # k L^2 times ((1 + e)^5 - 1) / 20 - e / 4, multiplied out.
            strain = s / relaxed[e]
            series = 0.5 + strain * (0.5 + strain * (0.25 + 0.05 * strain))
            return bars["stiffness"][e] * s**2 * series

        laws: dict[str, Callable[[Array, Array], Array]] = {
            "linear": linear,
            "cubic": lambda e, s: linear(e, s) + 0.25 * bars["stiffness_cubic"][e] * s**4,
            "cable": lambda e, s: linear(e, jnp.maximum(s, 0.0)),
            "strut": lambda e, s: linear(e, jnp.minimum(s, 0.0)),
            "ogden": ogden,
        }
        return self._by_law(laws, stretch)

    def hinge_energies(self, p: Parameters, bend: Array) -> Array:
        """Return elastic energies: (K,) [J]."""
        stiffness, rest = p["hinges"]["stiffness"], p["hinges"]["rest_angle"]
        energy = 0.5 * stiffness * bend**2
        if not len(self.walled):
            return energy
        low, high = self.limits
        angle = bend[self.walled] + rest[self.walled]
        walls = 0.0
        for excess, room in (
            (jnp.maximum(angle - high, 0.0), 2.0 * np.pi - high),
            (jnp.maximum(low - angle, 0.0), low),
        ):
            # Liu & Paulino 2017, doi:10.1098/rspa.2017.0348.
            scale = 2.0 * room / np.pi
            walls -= scale**2 * jnp.log(jnp.cos(excess / scale)) + 0.5 * excess**2
        return energy.at[self.walled].add(stiffness[self.walled] * walls)

    def stretches(self, p: Parameters, x: Array) -> Array:
        """Return lengths minus relaxed lengths: (M,) [m]."""
        bars = p["bars"]
        return self.lengths(x) - bars["rest_length"] * (1.0 + bars["prestress"])

    def energies(self, p: Parameters, x: Array) -> tuple[Array, Array, Array]:
        """Return potential energies of all bars, all hinges, and the weight [J]."""
        bend = self.bends(x, p["hinges"]["rest_angle"])
        return (
            jnp.sum(self.bar_energies(p, self.stretches(p, x))),
            jnp.sum(self.hinge_energies(p, bend)),
            -jnp.sum(p["masses"][:, None] * p["gravity"] * x),
        )

    def potential(self, p: Parameters, x: Array) -> Array:
        """Return the potential energy [J]."""
        return sum(self.energies(p, x))

    # --- losses -----------------------------------------------------------------------------

    def bar_dissipation(self, p: Parameters, stretch: Array, rate: Array) -> Array:
        """Return Rayleigh's function of each bar: (M,) [W]."""
        if self.printed:
            return jnp.zeros_like(rate)
        damping, cubic = p["bars"]["damping"], p["bars"]["damping_cubic"]

        def linear(e: Array, r: Array) -> Array:
            return 0.5 * damping[e] * r**2

        laws: dict[str, Callable[[Array, Array], Array]] = {
            "linear": linear,
            "cubic": lambda e, r: linear(e, r) + 0.25 * cubic[e] * r**4,
            "cable": lambda e, r: jnp.where(stretch[e] >= 0.0, linear(e, r), 0.0),
            "strut": lambda e, r: jnp.where(stretch[e] <= 0.0, linear(e, r), 0.0),
            "ogden": linear,
        }
        return self._by_law(laws, rate)

    def _by_law(self, laws: dict[str, Callable[[Array, Array], Array]], values: Array) -> Array:
        result = jnp.zeros_like(values)
        for law, chosen in self.of_law.items():
            if len(chosen):
                result = result.at[chosen].set(laws[law](chosen, values[chosen]))
        return result

    def rates(self, p: Parameters, x: Array, v: Array) -> tuple[Array, Array]:
        """Return rates of lengths (M,) [m/s] and of angles (K,) [rad/s]."""
        _, lengths = jax.jvp(self.lengths, (x,), (v,))
        _, angles = jax.jvp(lambda at: self.bends(at, p["hinges"]["rest_angle"]), (x,), (v,))
        return lengths, angles

    def drag(self, p: Parameters) -> Array:
        """Return drag coefficients of nodes: (N,) [kg/s]."""
        masses = p["masses"]
        mean = jnp.sum(jnp.where(self.massive, masses, 0.0)) / max(int(self.massive.sum()), 1)
        return p["damping"] * masses / jnp.where(mean > 0.0, mean, 1.0)

    def dissipation(self, p: Parameters, x: Array, v: Array, speed_up: Array) -> Array:
        """Return Rayleigh's dissipation function of the whole body [W].

        Parameters
        ----------
        speed_up : (3,)
            Factors of the rates that the drag, the bars and the hinges see. They are 1; a
            derivative with respect to one of them is the power lost there.
        """
        lengths, angles = self.rates(p, x, v)
        bars = self.bar_dissipation(p, self.stretches(p, x), speed_up[1] * lengths)
        return (
            0.5 * jnp.sum(self.drag(p)[:, None] * (speed_up[0] * v) ** 2)
            + jnp.sum(bars)
            + 0.5 * jnp.sum(p["hinges"]["damping"] * (speed_up[2] * angles) ** 2)
        )

    def printed_forces(self, p: Parameters, v: Array) -> Array:
        """Return the forces of the damping as the paper prints it: (N, 3) [N]."""
        i, j = self.ends[:, 0], self.ends[:, 1]
        slip = v[j] - v[i]
        ratio, stiffness = p["bars"]["damping"], p["bars"]["stiffness"]
        forces = jnp.zeros_like(v)
        for end, sign in ((i, 1.0), (j, -1.0)):
            # 0 is no place at which a root can be differentiated.
            square = p["masses"][end] * stiffness
            root = jnp.where(square > 0.0, jnp.sqrt(jnp.where(square > 0.0, square, 1.0)), 0.0)
            forces = forces.at[end].add(sign * (2.0 * ratio * root)[:, None] * slip)
        return forces

    # --- all of it --------------------------------------------------------------------------

    def forces(self, p: Parameters, x: Array, v: Array) -> tuple[Array, Array]:
        """Return all forces but those of actuators, and the powers that are lost.

        Returns
        -------
        forces : (N, 3) [N]
            ``-dU/dx - dD/dv`` with the potential energy U and the dissipation function D.
        losses : (3,) [W]
            To drag, in bars and in hinges.
        """

        def both(at: Array, speed: Array, speed_up: Array) -> Array:
            # Energy and dissipation in one pass back. D is given `x` itself, as it is not
            # differentiated by positions here, and still is by whoever differentiates a run.
            return self.potential(p, at) + self.dissipation(p, x, speed, speed_up)

        by_x, by_v, losses = jax.grad(both, argnums=(0, 1, 2))(x, v, jnp.ones(3))
        forces = -by_x - by_v
        if self.printed:
            printed = self.printed_forces(p, v)
            forces += printed
            losses = losses.at[1].add(-jnp.sum(printed * v))
        return forces, losses

    def tensions_and_moments(self, p: Parameters, x: Array, v: Array) -> tuple[Array, Array]:
        """Return tensions (M,) [N] and moments (K,) [N*m], spring and damper together."""
        lengths, angles = self.rates(p, x, v)
        stretch, bend = self.stretches(p, x), self.bends(x, p["hinges"]["rest_angle"])
        tension = jax.grad(lambda s: jnp.sum(self.bar_energies(p, s)))(stretch)
        tension += jax.grad(lambda r: jnp.sum(self.bar_dissipation(p, stretch, r)))(lengths)
        moment = jax.grad(lambda b: jnp.sum(self.hinge_energies(p, b)))(bend)
        return tension, moment + p["hinges"]["damping"] * angles
