"""Runge-Kutta steps in JAX, a frame compiled as a whole; runs and differentiable rollouts."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import TYPE_CHECKING, Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from openprc.demlat.backends.frames import diverged, frame_block, head, plausible_size
from openprc.demlat.backends.jax_body import JaxBody, Parameters, parameters_of
from openprc.demlat.backends.jax_signals import HIGHEST, components_of, look_up, table_of, tracks_of
from openprc.errors import ConfigError

if TYPE_CHECKING:
    from openprc.demlat.models.barhinge.tables import FrameBuffer
    from openprc.schema.experiment import Experiment

Array = Any
FULL_TURN = 2.0 * np.pi


class State(NamedTuple):
    """Positions [m], velocities [m/s], and the ledger [J] or None.

    The ledger: work, and what drag, bars, hinges and contact take.
    """

    x: Array
    v: Array
    ledger: Array | None


class Trajectory(NamedTuple):
    """All frames of a rollout.

    Attributes
    ----------
    positions, velocities : (n_frames, N, 3) [m], [m/s]
    """

    positions: Array
    velocities: Array


class JaxRun:
    """One scene in JAX.

    Parameters
    ----------
    experiment : Experiment
        One that `openprc.demlat.backends.choose.refusals` has nothing to say about.
    """

    def __init__(self, experiment: Experiment) -> None:
        self.experiment = experiment
        self.body = JaxBody(experiment)
        self.tracks, self.motion, self.pushes = tracks_of(experiment)
        self.components = components_of(experiment, self.tracks)
        self.h = experiment.save_interval / experiment.steps_per_frame

    # --- drives -----------------------------------------------------------------------------

    def table(self, p: Parameters) -> Array:
        """Return the polynomials of all signals."""
        return table_of(self.tracks, p["signals"]) if self.tracks else jnp.zeros((0, HIGHEST))

    def place(
        self, p: Parameters, table: Array, x: Array, v: Array, times: tuple[Array, Array, Array]
    ) -> tuple[Array, Array]:
        """Return positions and velocities with the driven coordinates in place."""
        rows = self.motion
        if not len(rows.node):
            return x, v
        values, rates = look_up(self.components, table, *times)
        start = jnp.where(rows.from_start, p["positions"][rows.node, rows.axis], 0.0)
        at = rows.node, rows.axis
        return (
            x.at[at].set(start + values[rows.component]),
            v.at[at].set(rates[rows.component]),
        )

    # --- one step ---------------------------------------------------------------------------

    def slopes(
        self,
        p: Parameters,
        table: Array,
        x: Array,
        v: Array,
        times: tuple[Array, Array, Array],
        *,
        ledger: bool,
    ) -> State:
        """Return the rates of change of the state."""
        body, motion, pushes = self.body, self.motion, self.pushes
        force, losses = body.forces(p, x, v)
        work = -jnp.sum((force * v)[motion.node, motion.axis])
        if len(pushes.node):
            values, _ = look_up(self.components, table, *times)
            at = pushes.node, pushes.axis
            force = force.at[at].add(values[pushes.component])
            work += jnp.sum(values[pushes.component] * v[at])
        mass = jnp.where(body.free, p["masses"][:, None], 1.0)
        powers = jnp.concatenate([work[None], losses, jnp.zeros(1)]) if ledger else None
        return State(v, jnp.where(body.free, force / mass, 0.0), powers)

    def step(self, p: Parameters, table: Array, state: State, number: Array) -> State:
        """Take step `number` of the classical Runge-Kutta scheme."""
        h = self.h
        t = number * h

        def stage(carried: tuple[State, State], row: Array) -> tuple[tuple[State, State], None]:
            slope, total = carried
            ahead, weight = row
            x, v = state.x + ahead * slope.x, state.v + ahead * slope.v
            times = (t + ahead, t, t + h)
            x, v = self.place(p, table, x, v, times)
            slope = self.slopes(p, table, x, v, times, ledger=state.ledger is not None)
            return (slope, jax.tree.map(lambda y, k: y + weight * k, total, slope)), None

        # One stage is compiled, not four.
        stages = jnp.array([[0.0, h / 6], [h / 2, h / 3], [h / 2, h / 3], [h, h / 6]])
        none = jax.tree.map(jnp.zeros_like, state)
        (_, total), _ = jax.lax.scan(stage, (none, none), stages)
        moved = jax.tree.map(jnp.add, state, total)
        x, v = self.place(p, table, moved.x, moved.v, (t + h, t, t + h))
        t = (number + 1) * h
        return self._cross(p, table, moved._replace(x=x, v=v), (t, t, t + h))

    def _cross(
        self, p: Parameters, table: Array, state: State, times: tuple[Array, Array, Array]
    ) -> State:
        """Hand driven coordinates over to the segments that begin now.

        A held signal moves its coordinates at once; the energy that this takes is work.
        """
        x, v = self.place(p, table, state.x, state.v, times)
        rows, ledger = self.motion, state.ledger
        if ledger is not None and rows.held.any():
            at = rows.node[rows.held], rows.axis[rows.held]
            before, after = jax.lax.map(partial(self.body.potential, p), jnp.stack([state.x, x]))
            jumped = jnp.any(x[at] != state.x[at])
            ledger = ledger.at[0].add(jnp.where(jumped, after - before, 0.0))
        return State(x, v, ledger)

    def start(self, p: Parameters, table: Array, *, ledger: bool = True) -> State:
        """Return the state at t = 0, driven coordinates in place."""
        x, v = jnp.asarray(p["positions"]), jnp.asarray(p["velocities"])
        x, v = self.place(p, table, x, v, (0.0, 0.0, self.h))
        work = jnp.zeros(5).at[0].add(-self._driven_energy(p, v))
        return State(x, v, work if ledger else None)

    def frame(self, p: Parameters, table: Array, state: State, number: Array) -> State:
        """Go from frame `number` to the next."""
        count = self.experiment.steps_per_frame

        def one(now: State, i: Array) -> tuple[State, None]:
            return self.step(p, table, now, number * count + i), None

        return jax.lax.scan(one, state, jnp.arange(count))[0]

    # --- frames -----------------------------------------------------------------------------

    def _driven_energy(self, p: Parameters, v: Array) -> Array:
        rows = self.motion
        return 0.5 * jnp.sum(p["masses"][rows.node] * v[rows.node, rows.axis] ** 2)

    def saved(self, p: Parameters, state: State) -> tuple[Array, ...]:
        """Return what is saved of a state, in the order of `FrameBuffer`."""
        body, rest = self.body, p["hinges"]["rest_angle"]
        x, v, ledger = state
        tension, moment = body.tensions_and_moments(p, x, v)
        kinetic = 0.5 * jnp.sum(p["masses"][:, None] * v**2)
        return (
            x,
            v,
            body.lengths(x),
            tension,
            jnp.mod(body.bends(x, rest) + rest, FULL_TURN),
            moment,
            jnp.stack([kinetic, *body.energies(p, x)]),
            ledger.at[0].add(self._driven_energy(p, v)),
        )

    def blocks(self) -> Iterator[tuple[int, FrameBuffer]]:
        """Integrate, yielding (number of the first frame, block of frames).

        As `BarHingeModel.blocks`.
        """
        experiment, out = self.experiment, frame_block(self.experiment)
        p, limit = parameters_of(experiment), plausible_size(experiment)

        # Never across a `yield`: the precision of what the caller does is not ours to choose.
        with jax.enable_x64(True):
            prepare = jax.jit(lambda p: (table := self.table(p), self.start(p, table)))
            advance, observe = jax.jit(self.frame), jax.jit(self.saved)
            table, state = prepare(p)
            _keep(out, 0, observe(p, state))
        yield 0, head(out, 1)
        first, row = 1, 0
        for frame in range(experiment.n_frames - 1):
            with jax.enable_x64(True):
                state = advance(p, table, state, frame)
                saved = observe(p, state)
                x = np.asarray(state.x)
            bad = np.argwhere(~(np.abs(x.T) < limit))
            if len(bad):
                if row:
                    yield first, head(out, row)
                axis, node = bad[0]
                time = (frame + 1) * experiment.save_interval
                raise diverged(experiment, x, node=int(node), axis=int(axis), time=time)
            _keep(out, row, saved)
            row += 1
            if row == len(out.x) or frame == experiment.n_frames - 2:
                yield first, head(out, row)
                first, row = first + row, 0

    def rollout(self, p: Parameters) -> Trajectory:
        """Return all frames as a function of the parameters that JAX can differentiate."""
        table = self.table(p)
        start = self.start(p, table, ledger=False)

        # Only frames are kept for the way back; the steps between them are taken again.
        @jax.checkpoint
        def one(state: State, number: Array) -> tuple[State, tuple[Array, Array]]:
            state = self.frame(p, table, state, number)
            return state, (state.x, state.v)

        _, (x, v) = jax.lax.scan(one, start, jnp.arange(self.experiment.n_frames - 1))
        return Trajectory(jnp.concatenate([start.x[None], x]), jnp.concatenate([start.v[None], v]))


def _keep(out: FrameBuffer, row: int, saved: tuple[Array, ...]) -> None:
    for target, value in zip(out[: len(saved)], saved, strict=True):
        target[row] = np.asarray(value)


def jax_blocks(experiment: Experiment) -> Iterator[tuple[int, FrameBuffer]]:
    """Integrate `experiment` in JAX, as `BarHingeModel.blocks`."""
    yield from JaxRun(experiment).blocks()


def differentiable(
    experiment: Experiment,
) -> tuple[Callable[[Parameters], Trajectory], dict[str, Any]]:
    """Return the rollout of `experiment` and its parameters; see `jax_rollout`."""
    run = JaxRun(experiment)

    def rollout(parameters: Parameters) -> Trajectory:
        if not jax.config.jax_enable_x64:
            raise ConfigError(
                "a rollout in float32, which is what JAX computes in by default",
                expected="float64: positions and rest lengths are subtracted from each other",
                fix="call it, and its gradient, inside `with jax.enable_x64(True):`",
                key="jax_enable_x64",
            )
        return run.rollout(parameters)

    return rollout, parameters_of(experiment)
