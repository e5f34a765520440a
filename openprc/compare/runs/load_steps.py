"""A path of equilibria beside a run in time: at which instant each of its states belongs.

Quasi-static producers count increments. Where the drive of the experiment says when its load
reaches that of an increment, the increment gets that instant, and the path can be compared with
a run in time that is slow enough.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from openprc.compare.runs.known_motion import declare_like
from openprc.demlat.signal_table import sample_signal
from openprc.errors import ConfigError
from openprc.schema.provenance import Provenance, typed_command
from openprc.schema.trajectory import Trajectory
from openprc.schema.writer import TrajectoryWriter

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.schema.experiment import Experiment

    Reals = NDArray[np.float64]

_SAME = 1e-9
#: Beyond the load of the last instant by no more than what rounding does.
_BEYOND = 1e-6


def counts_increments(path: str | Path) -> bool:
    """Tell whether a trajectory has load steps instead of time."""
    with Trajectory(path) as run:
        return run.time_kind == "pseudo"


def time_increments(
    path: Path, experiment: Experiment, target: Path, *, overwrite: bool = False
) -> str:
    """Write the states of a path of equilibria with the instants that they belong to.

    Parameters
    ----------
    path : Path
        A quasi-static run of `experiment`.
    experiment : Experiment
    target : Path
        The trajectory to write; it has positions only.

    Returns
    -------
    str
        How instants were found, in a sentence.

    Raises
    ------
    ConfigError
        When the increments cannot be put in time.
    """
    with Trajectory(path) as run:
        times, kept, how = _instants(run, experiment)
        with TrajectoryWriter(
            target,
            provenance=Provenance(
                str(run.provenance.get("producer", "unknown")), command=typed_command()
            ),
            overwrite=overwrite,
            on_failure="discard",
        ) as writer:
            writer.add_source(path, role="path of equilibria")
            writer.note(how)
            dims = declare_like(experiment, writer)
            for time, frame in zip(times, kept, strict=True):
                x = run.positions(slice(frame, frame + 1), unit="m")[0]
                writer.append(float(time), positions=x[:, :dims])
    return how


def _instants(run: Trajectory, experiment: Experiment) -> tuple[Reals, NDArray[np.intp], str]:
    frames = np.arange(run.n_frames)
    if "load" in run.inputs and "load" not in experiment.signals:
        return _by_factor(run.input("load").value[:, 0], experiment)
    if run.n_frames <= experiment.n_frames:
        at = experiment.frame_times[: run.n_frames]
        if all(_follows(run, experiment, name, at) for name in run.inputs):
            return at, frames, "every increment stands for the frame at which its drives are set"
    raise _untimed(
        f"its {run.n_frames} increments do not follow the drives of the experiment frame by frame"
    )


def _follows(run: Trajectory, experiment: Experiment, name: str, at: Reals) -> bool:
    signal = next(
        (s for key, s in experiment.signals.items() if name in (key, *_with_quantity(key))), None
    )
    if signal is None:
        return False
    wanted, found = sample_signal(signal, at), run.input(name).value
    size = max(float(np.abs(wanted).max(initial=0.0)), 1e-300)
    return wanted.shape == found.shape and bool((np.abs(wanted - found) <= _SAME * size).all())


def _with_quantity(signal: str) -> tuple[str, ...]:
    return tuple(f"{signal} {quantity}" for quantity in ("force", "position", "velocity"))


def _by_factor(factors: Reals, experiment: Experiment) -> tuple[Reals, NDArray[np.intp], str]:
    """Find when the forces reach each factor, for forces that grow together and steadily."""
    names = dict.fromkeys(a.signal for a in experiment.actuators if a.type == "force")
    at = np.linspace(0.0, experiment.duration, 20_001)
    shares = []
    for name in names:
        values = sample_signal(experiment.signals[name], at)
        column = int(np.abs(values[-1]).argmax())
        if values[-1, column] == 0.0:
            raise _untimed("a force is zero at the end of the run, where the load factor is 1")
        shares.append(values[:, column] / values[-1, column])
    course = shares[0]
    alike = all(np.abs(share - course).max() <= _SAME for share in shares[1:])
    if not alike or (np.diff(course) < 0.0).any():
        raise _untimed("its forces do not all grow steadily, in one proportion")
    # A path that turns back at a limit point has no instant after that.
    turned = np.flatnonzero(np.diff(factors) <= 0.0)
    last = int(turned[0]) + 1 if turned.size else len(factors)
    kept = np.flatnonzero(
        (factors[:last] >= course[0] - _BEYOND) & (factors[:last] <= course[-1] + _BEYOND)
    )
    grows = np.flatnonzero(np.diff(course, prepend=-np.inf) > 0.0)
    times = np.interp(factors[kept], course[grows], at[grows])
    kept = kept[np.diff(times, prepend=-np.inf) > 0.0]
    if len(kept) < 2:
        raise _untimed("fewer than two of its increments are at loads that the run in time has")
    times = np.interp(factors[kept], course[grows], at[grows])
    return (
        times,
        kept,
        (
            f"{len(kept)} of {len(factors)} increments stand for the instants at which the forces"
            " have their load factor"
        ),
    )


def _untimed(found: str) -> ConfigError:
    return ConfigError(
        f"a path of equilibria cannot be put beside a run in time: {found}",
        expected="increments that follow the drives, or forces that grow in proportion",
        fix="drive positions, or run it with merlin:control=load, where an increment is a frame",
    )


__all__ = ["counts_increments", "time_increments"]
