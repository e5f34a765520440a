"""Perturbed twins: the same run begun a hair elsewhere, and how far apart the two get."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.compare.chaos.growth import Growth, measure_growth
from openprc.compare.runs.producers import run_once
from openprc.compare.runs.requests import Request
from openprc.errors import ConfigError
from openprc.hooks.running import silent
from openprc.schema.experiment import Stored
from openprc.schema.trajectory import Trajectory

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from openprc.hooks.protocols import Progress
    from openprc.hooks.registry import Registry
    from openprc.schema.experiment import Experiment

    Reals = NDArray[np.float64]

#: Displacements of the twins, in shares of the scale: two, to see that the growth is linear.
SIZES = (1e-9, 1e-7)
#: Separations of twins in a ratio within this factor of that of their displacements are linear.
LINEAR_WITHIN = 1.2
_BLOCK_BYTES = 8 << 20
_SEED = 20260


@dataclass(frozen=True, kw_only=True, eq=False)
class TwinStudy:
    """What became of two small displacements of the start.

    Parameters
    ----------
    request : str
        Which run was repeated.
    scale : float [m]
        Of the motion.
    sizes : (2,) float
        Root mean squares over nodes of the displacements, over the scale.
    times : (T,) float64 [s]
    separations : (2, T) float64
        Root mean squares over nodes of the distances to the run that was not displaced, over the
        scale.
    growths : tuple of Growth or None
        One for each displacement.
    linearity : float or None
        Median, while both are small, of the ratio of the separations over the ratio of the
        displacements: 1 where rounding and saturation play no part.
    """

    request: str
    scale: float
    sizes: tuple[float, float]
    times: Reals
    separations: Reals
    growths: tuple[Growth | None, Growth | None]
    linearity: float | None

    @property
    def growth(self) -> Growth | None:
        """Of the smaller displacement, which stays small for longer."""
        return self.growths[0] or self.growths[1]

    @property
    def chaotic(self) -> bool:
        """Whether the twins part exponentially, both at the same rate, and linearly."""
        small, large = self.growths
        if small is None or small.kind != "exponential" or self.linearity is None:
            return False
        if not 1.0 / LINEAR_WITHIN < self.linearity < LINEAR_WITHIN:
            return False
        if large is None or large.factor < 1e1:
            return True  # the larger one is saturated before it can tell
        slack = 3.0 * np.hypot(small.uncertainty, large.uncertainty)
        return bool(abs(small.rate - large.rate) <= max(slack, 0.5 * small.rate))

    @property
    def amplification(self) -> Reals:
        """How many times a small displacement has grown at most by then: (T,)."""
        grown = np.maximum.accumulate(self.separations[0])
        # Rigid bars take part of the displacement back.
        factor: Reals = grown / (grown[0] or self.sizes[0])
        return factor

    def amplification_at(self, time: float) -> float:
        """Return the amplification at an instant [s]."""
        return float(np.interp(time, self.times, self.amplification))

    def as_dict(self) -> dict[str, Any]:
        """Return plain data, for JSON; of the separations at most 500 instants."""
        shown = np.unique(np.linspace(0, len(self.times) - 1, 500).astype(int))
        return {
            "request": self.request,
            "scale_m": self.scale,
            "sizes": list(self.sizes),
            "chaotic": self.chaotic,
            "linearity": self.linearity,
            "growth": [None if one is None else one.as_dict() for one in self.growths],
            "times_s": self.times[shown].tolist(),
            "separations": self.separations[:, shown].tolist(),
        }


def twin_study(
    experiment: Experiment,
    *,
    scale: float,
    request: Request | None = None,
    sizes: tuple[float, float] = SIZES,
    progress: Progress = silent,
    registry: Registry | None = None,
) -> TwinStudy:
    """Run an experiment three times, twice from a start that is displaced, and compare.

    Everything runs in float64, in files that are thrown away. Nodes are displaced at random,
    within the space that the body moves in: what stays in a plane for reasons of symmetry is not
    pushed out of it.

    Parameters
    ----------
    experiment : Experiment
    scale : float [m]
        Of the motion.
    request : Request, optional
        Who runs it, and how; demlat with the settings of the experiment by default.
    sizes : (float, float)
        Displacements, in shares of the scale.

    Raises
    ------
    ConfigError
        When nothing can be displaced, or the body does not move.
    OpenPRCError
        When the experiment does not run.
    """
    request = request or Request(name="demlat", producer="demlat")
    plain = replace(
        request.changed(experiment),
        precision="float64", stored=Stored(velocities=False, elements=False),
    )  # fmt: skip
    bare = replace(request, changes={})
    with tempfile.TemporaryDirectory(prefix="openprc-") as scratch:
        paths = [Path(scratch) / f"{name}.h5" for name in ("base", "small", "large")]

        def part(k: int) -> Progress:
            return lambda fraction, message: progress((k + fraction) / 3.0, f"twin: {message}")

        run_once(plain, bare, paths[0], progress=part(0), registry=registry)
        pattern = displacements(plain, paths[0])
        for k, size in enumerate(sizes, 1):
            displaced = _displaced(plain, size * scale * pattern)
            run_once(displaced, bare, paths[k], progress=part(k), registry=registry)
        times, *parted = (
            np.concatenate(parts) for parts in zip(*_separations(paths[0], paths[1:]), strict=True)
        )
    separations = np.array(parted) / scale
    return TwinStudy(
        request=request.name,
        scale=scale,
        sizes=sizes,
        times=times,
        separations=separations,
        growths=(measure_growth(times, separations[0]), measure_growth(times, separations[1])),
        linearity=_linearity(separations, sizes),
    )


def displacements(experiment: Experiment, base: Path) -> Reals:
    """Return a random pattern of displacements with root mean square 1 over nodes: (N, 3).

    Parameters
    ----------
    experiment : Experiment
    base : Path
        A run of it.

    Raises
    ------
    ConfigError
        When no coordinate is free, or nothing moves.
    """
    free = ~experiment.held_axes
    with Trajectory(base) as run:
        chosen = np.unique(np.linspace(0, run.n_frames - 1, 200).astype(int))
        moved = np.concatenate(
            [run.positions(slice(k, k + 1), unit="m") for k in chosen]
        ) - run.positions(slice(0, 1), unit="m")
    flat = np.zeros((moved.shape[0] * moved.shape[1], 3))
    flat[:, : moved.shape[2]] = moved.reshape(-1, moved.shape[2])
    _, strengths, axes = np.linalg.svd(flat, full_matrices=False)
    if not strengths[0] > 0.0 or not free.any():
        raise ConfigError(
            "nothing moves in this run" if free.any() else "no node is free to move",
            expected="a body in motion, to displace its start",
            fix="leave the perturbed twins out",
        )
    # Rounding of a motion in a plane stays far below a millionth of it.
    space = axes[strengths > 1e-6 * strengths[0]]
    drawn = np.random.default_rng(_SEED).normal(size=free.shape)
    pattern = np.where(free, drawn @ space.T @ space, 0.0)
    size = np.sqrt((pattern**2).sum(axis=1).mean())
    normalised: Reals = pattern / size
    return normalised


def _displaced(experiment: Experiment, shift: Reals) -> Experiment:
    geometry = experiment.geometry
    return replace(experiment, geometry=replace(geometry, positions=geometry.positions + shift))


def _separations(base: Path, twins: Sequence[Path]) -> Iterator[tuple[Reals, ...]]:
    """Yield times and separations [m] of the twins, block by block."""
    opened = [Trajectory(path) for path in (base, *twins)]
    try:
        first = opened[0]
        rows = max(1, _BLOCK_BYTES // max(1, 8 * first.n_nodes * first.dims))
        for start in range(0, first.n_frames, rows):
            frames = slice(start, min(start + rows, first.n_frames))
            x = first.positions(frames, unit="m")
            yield (
                first.time[frames],
                *(
                    np.sqrt(((run.positions(frames, unit="m") - x) ** 2).sum(axis=2).mean(axis=1))
                    for run in opened[1:]
                ),
            )
    finally:
        for run in opened:
            run.close()


def _linearity(separations: Reals, sizes: tuple[float, float]) -> float | None:
    small = (separations[0] > 0.0) & (separations[1] < 1e-2)
    if not small.any():
        return None
    return float(np.median(separations[1, small] / separations[0, small]) * sizes[0] / sizes[1])


__all__ = ["SIZES", "TwinStudy", "displacements", "twin_study"]
