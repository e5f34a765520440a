"""Equilibrium from a state: Newton's method downhill, with rigid elements kept exactly."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from openprc.demlat.statics.assembly import StaticProblem
from openprc.demlat.statics.descent import Descent
from openprc.demlat.statics.eigenpairs import pieces
from openprc.demlat.statics.inertia import Stability, stability
from openprc.errors import ConfigError, NotConverged

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

    from openprc.schema.experiment import Experiment

    Reals = NDArray[np.float64]

#: How often the search may leave a saddle along a direction that gains energy.
_ESCAPES = 20


@dataclass(frozen=True, kw_only=True, eq=False)
class Equilibrium:
    """A state in which forces balance.

    Attributes
    ----------
    positions : (N, 3) [m]
    energy : float [J]
        Of bars, hinges, bends, weight and loads, the latter two counted from the origin.
    residual : float [N]
        Largest force out of balance at a free degree of freedom.
    tolerance : float [N]
        What the residual had to reach.
    iterations : int
    escapes : int
        Saddles that were met and left on the way to a minimum.
    stability : Stability
    reactions : (N, 3) [N]
        Forces of the supports on the body, 0 at free axes.
    bar_forces : (M,) [N]
        Tensions, those of rigid bars included.
    hinge_moments : (K,) [N m]
        Those of rigid hinges included.
    bend_torques : (B,) [N m]
        ``stiffness * (angle - rest)``.
    """

    positions: Reals
    energy: float
    residual: float
    tolerance: float
    iterations: int
    escapes: int
    stability: Stability
    reactions: Reals
    bar_forces: Reals
    hinge_moments: Reals
    bend_torques: Reals


def find_equilibrium(
    problem: StaticProblem,
    start: ArrayLike | None = None,
    *,
    kind: Literal["minimum", "stationary"] = "minimum",
    tolerance: float = 1e-10,
    force_tolerance: float = 0.0,
    max_iterations: int = 500,
    max_step: float | None = None,
    load_steps: int = 1,
) -> Equilibrium:
    """Find the equilibrium that a state leads to.

    "minimum" goes downhill: Newton's step where the energy is convex, a shifted one elsewhere,
    shortened until the energy falls; where it ends on a saddle it leaves along the softest
    direction. "stationary" takes plain Newton steps to an equilibrium nearby, stable or not.

    Parameters
    ----------
    problem : StaticProblem
    start : (N, 3) [m], optional
        The positions of the problem unless given; held axes are moved to where they belong.
    kind : {"minimum", "stationary"}
    tolerance : float
        Largest residual, relative to the largest force of an element or load; where all of
        these vanish, the rounding of the positions sets the limit.
    force_tolerance : float [N]
        A residual below it counts as zero anyway. Mechanisms without tension relax slowly,
        since the forces vanish faster than the way that is left.
    max_iterations : int
    max_step : float [m], optional
        Largest displacement of a node in one iteration; half the median bar length unless
        given.
    load_steps : int
        In how many equal parts held axes move from `start` to where they belong, with an
        equilibrium after each.

    Returns
    -------
    Equilibrium

    Raises
    ------
    ConfigError
        When an argument is wrong, or a load acts on a piece that nothing holds.
    NotConverged
        When no equilibrium is reached.

    Examples
    --------
    >>> from openprc.demlat.geometry_builder import GeometryBuilder
    >>> from openprc.demlat.statics import StaticProblem, find_equilibrium
    >>> build = GeometryBuilder()
    >>> top = build.add_node([0.0, 0.0, 0.0], fixed=True)
    >>> bob = build.add_node([0.0, 0.0, -1.0], mass=2.0)
    >>> bar = build.add_bar(top, bob, stiffness=1000.0)
    >>> problem = StaticProblem(geometry=build.geometry(), gravity=(0.0, 0.0, -10.0))
    >>> found = find_equilibrium(problem)
    >>> print(f"{found.positions[bob, 2]:.4f} m, {found.stability.kind}")
    -1.0200 m, stable
    """
    if kind not in ("minimum", "stationary"):
        raise ConfigError(f"found {kind!r}", expected="'minimum' or 'stationary'", key="kind")
    if load_steps < 1:
        raise ConfigError(f"{load_steps} steps", expected="at least 1", key="load_steps")
    refuse_floating(problem)
    x = np.array(problem.positions if start is None else start, dtype="f8")
    if x.shape != problem.positions.shape or not np.isfinite(x).all():
        raise ConfigError(
            f"a start of shape {x.shape}" if np.isfinite(x).all() else "NaN or infinity",
            expected=f"finite numbers of shape {problem.positions.shape}",
            key="start",
        )
    settings: dict[str, Any] = {
        "tolerance": tolerance,
        "force_tolerance": force_tolerance,
        "max_step": max_step,
        "kind": kind,
    }
    begin, iterations = x.copy(), 0
    for step in range(1, load_steps):
        way = begin + (problem.positions - begin) * (step / load_steps)
        part = replace(problem, positions=np.where(problem.held, way, problem.positions))
        search = Descent(part, **settings)
        x, used = search.run(part.place(x), max_iterations=max_iterations - iterations)
        iterations += used
    search = Descent(problem, **settings)
    x = problem.place(x)
    for escapes in range(_ESCAPES + 1):
        x, used = search.run(x, max_iterations=max_iterations - iterations)
        iterations += used
        found = stability(problem, x)
        if kind == "stationary" or not found.n_negative:
            return _record(problem, search, x, iterations, escapes, found)
        x = search.leave_saddle(x, found.directions[0])
    raise NotConverged(
        f"{_ESCAPES} saddles in a row and no minimum",
        expected="a state from which the energy falls to a minimum",
        fix="start elsewhere, or ask for kind='stationary'",
    )


def equilibrated(
    experiment: Experiment,
    *,
    time: float = 0.0,
    start: ArrayLike | None = None,
    tolerance: float = 1e-10,
    force_tolerance: float = 0.0,
    max_iterations: int = 500,
    load_steps: int = 1,
) -> Experiment:
    """Return the experiment with its nodes at rest in equilibrium.

    Rest lengths and rest angles stay as they are, so a run begins without a transient: what
    the dynamics would settle to under the loads of `time` is where it starts.

    Parameters
    ----------
    experiment : Experiment
    time : float [s]
        When signals are read.
    start, tolerance, force_tolerance, max_iterations, load_steps
        As for `find_equilibrium`.

    Raises
    ------
    ConfigError, UnsupportedScene, NotConverged
        As `StaticProblem.from_experiment` and `find_equilibrium` do.

    Examples
    --------
    >>> from openprc.demlat import SimulationSetup
    >>> from openprc.demlat.statics import equilibrated
    >>> setup = SimulationSetup("pendulum", overwrite=True)
    >>> pivot = setup.add_node([0.0, 0.0, 0.0], fixed=True)
    >>> bob = setup.add_node([0.6, 0.0, 0.0], mass=2.0)
    >>> bar = setup.add_bar(pivot, bob, stiffness=1000.0)
    >>> setup.set_physics(gravity=-10.0)
    >>> setup.set_simulation_params(duration=1.0, dt=1e-3, save_interval=0.01)
    >>> still = equilibrated(setup.experiment())
    >>> print(f"{still.geometry.positions[bob, 2]:.3f} m")
    -0.620 m
    """
    found = find_equilibrium(
        StaticProblem.from_experiment(experiment, time=time),
        start,
        tolerance=tolerance,
        force_tolerance=force_tolerance,
        max_iterations=max_iterations,
        load_steps=load_steps,
    )
    still = np.zeros_like(found.positions)
    geometry = replace(experiment.geometry, positions=found.positions, velocities=still)
    return replace(experiment, geometry=geometry)


def _record(
    problem: StaticProblem,
    search: Descent,
    x: Reals,
    iterations: int,
    escapes: int,
    found: Stability,
) -> Equilibrium:
    state = search.state(x)
    tensions, moments = problem.bar_forces(x), problem.hinge_moments(x)
    whole = problem.gradient(x)
    if state.multipliers is not None:
        rigid = problem.rigid_forces(state.multipliers)
        tensions[problem.rigid_bars], moments[problem.rigid_hinges] = rigid
        carried = problem.constraint_jacobian(x, whole=True).T @ state.multipliers
        whole = whole + carried.reshape(-1, 3)
    return Equilibrium(
        positions=x,
        energy=problem.energy(x),
        residual=state.size,
        tolerance=state.limit,
        iterations=iterations,
        escapes=escapes,
        stability=found,
        reactions=np.where(problem.held, whole, 0.0),
        bar_forces=tensions,
        hinge_moments=moments,
        bend_torques=problem.bend_torques(x),
    )


def refuse_floating(problem: StaticProblem) -> None:
    """Refuse loads on pieces that nothing holds: they accelerate, so there is no equilibrium.

    Raises
    ------
    ConfigError
        When there are some.
    """
    if not problem.applied.any():
        return
    count, labels = pieces(problem)
    for axis in range(3):
        total = np.bincount(labels, weights=problem.applied[:, axis], minlength=count)
        size = np.bincount(labels, weights=np.abs(problem.applied[:, axis]), minlength=count)
        held = np.bincount(labels, weights=problem.held[:, axis], minlength=count)
        loose = np.flatnonzero((held == 0) & (np.abs(total) > 1e-9 * size))
        if len(loose):
            nodes = np.flatnonzero(labels == loose[0])
            raise ConfigError(
                f"a load of {total[loose[0]]:g} N along {'xyz'[axis]} on the piece of node"
                f" {int(nodes[0])}, which nothing holds",
                expected="loads that supports can carry",
                fix="fix a node of the piece, or hold one of its axes",
                key="loads",
            )
