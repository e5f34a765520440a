"""Trajectories as differentiable functions of a body's parameters."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from openprc.demlat.backends.choose import refusals
from openprc.demlat.backends.devices import probe_jax
from openprc.errors import MissingDependency
from openprc.hooks.running import refuse_unsupported

if TYPE_CHECKING:
    from openprc.demlat.backends.jax_run import Trajectory
    from openprc.schema.experiment import Experiment


def jax_rollout(
    experiment: Experiment,
) -> tuple[Callable[[dict[str, Any]], Trajectory], dict[str, Any]]:
    """Return the simulation of `experiment` as a function that JAX can differentiate.

    Parameters
    ----------
    experiment : Experiment
        With the integrator "rk4"; see `refusals`.

    Returns
    -------
    rollout : callable
        Takes parameters, returns a named tuple: positions and velocities (n_frames, N, 3) of all
        frames, [m] and [m/s]. To be called, differentiated and compiled in float64, that is
        inside ``with jax.enable_x64(True):``.
    parameters : dict
        Those of the experiment, a tree of arrays: "positions", "velocities", "masses", "damping",
        "gravity", "bars" and "hinges" by column, "signals" by name. What it leaves out (who is
        connected to whom, laws, limits, times) is fixed.

    Raises
    ------
    MissingDependency
        When there is no JAX, or one older than 0.8.
    UnsupportedScene
        When the scene has something that the JAX back end cannot do.

    Examples
    --------
    The slope of the last height of a node with respect to every stiffness::

        rollout, parameters = jax_rollout(experiment)

        def height(stiffness):
            bars = parameters["bars"] | {"stiffness": stiffness}
            return rollout(parameters | {"bars": bars}).positions[-1, 4, 2]

        with jax.enable_x64(True):
            slope = jax.grad(height)(parameters["bars"]["stiffness"])
    """
    probe = probe_jax(only_accelerated=False)
    if not probe.usable:
        raise MissingDependency(
            f"a differentiable rollout was asked for; {probe.found}",
            expected=probe.missing or "jax 0.8 or newer",
            fix="install it with `pip install 'openprc[jax]'`",
        )
    # Nobody who does not differentiate waits for JAX.
    from openprc.demlat.backends.jax_run import differentiable  # noqa: PLC0415

    refuse_unsupported(refusals(experiment, "jax"), producer="demlat with JAX")
    return differentiable(experiment)
