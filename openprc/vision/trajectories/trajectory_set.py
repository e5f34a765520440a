"""`TrajectorySet`: calibrated tracks, and what may be done to them."""

from __future__ import annotations

from dataclasses import KW_ONLY, dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import ConfigError
from openprc.vision.tracking.status import Status
from openprc.vision.trajectories import gaps, motion, resampling, signals, smoothing
from openprc.vision.trajectories.calibrated import calibrated
from openprc.vision.trajectories.checks import point_mask, settle

if TYPE_CHECKING:
    from openprc.vision.tracking.result import TrackingResult

MISSING, MEASURED, FILLED = 0, 1, 2


@dataclass(frozen=True, eq=False)
class TrajectorySet:
    """Where points are over time. Every operation returns a new set and leaves this one.

    Attributes
    ----------
    positions : (T, N, D) [units], D = 2 or 3
        NaN exactly where `observed` is 0.
    timestamps : (T,) [s]
        Increasing.
    status : (T, N)
        Codes of `openprc.vision.Status`.
    observed : (T, N)
        0 missing, 1 measured, 2 filled in.
    quality : (T, N), optional
        Zero-normalised cross-correlation with the template.
    sigma : (T, N, D) [units], optional
        One-sigma of every position.
    template : (T, N), optional
        How many times the point's template had been renewed.
    positions_px : (T, N, 2) [px], optional
        What the tracker measured, before calibration and before anything was done to it.
    units : str
        A unit of `openprc.schema.units`.
    axes : tuple of str
        Names of the D axes.
    frame : str
        Frame of reference: ``image`` (x right, y down), or what the calibration says.
    feature_ids : (N,)
        Numbers of the points where they were detected.
    calibration : object, optional
        What positions were calibrated with.
    operations : tuple of dict
        What was done, in order, with its settings.
    notes : tuple of str
        What the user should know.

    Raises
    ------
    ConfigError
        When the arrays do not fit together.
    """

    positions: NDArray[np.float64]
    timestamps: NDArray[np.float64]
    _: KW_ONLY
    status: NDArray[np.uint8] = field(default=None)  # type: ignore[assignment]
    observed: NDArray[np.uint8] = field(default=None)  # type: ignore[assignment]
    quality: NDArray[np.float32] | None = None
    sigma: NDArray[np.float64] | None = None
    template: NDArray[np.int32] | None = None
    positions_px: NDArray[np.float64] | None = None
    units: str = "px"
    axes: tuple[str, ...] = ()
    frame: str = "image"
    feature_ids: NDArray[np.int64] = field(default=None)  # type: ignore[assignment]
    calibration: Any = None
    operations: tuple[dict[str, Any], ...] = ()
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name, value in settle(self).items():
            object.__setattr__(self, name, value)

    @classmethod
    def from_tracking_result(
        cls, result: TrackingResult, *, calibration: Any = None
    ) -> TrajectorySet:
        """Take the tracks as they are [px], or put them into the units of `calibration`.

        Parameters
        ----------
        result : TrackingResult
        calibration : NormalizedCalibration, CameraCalibration, ScaleBar, PlanarTarget, optional
            One that was made for images of another size is warned of.
        """
        return cls(**calibrated(result, calibration))

    # --- what it holds ---------------------------------------------------------------------

    @property
    def n_frames(self) -> int:
        """Number of frames, T."""
        return int(self.positions.shape[0])

    @property
    def n_features(self) -> int:
        """Number of points, N."""
        return int(self.positions.shape[1])

    @property
    def dims(self) -> int:
        """Number of axes, D."""
        return int(self.positions.shape[2])

    @property
    def fps(self) -> float:
        """Mean frame rate [Hz], NaN for a single frame."""
        return (self.n_frames - 1) / self.duration if self.n_frames > 1 else float("nan")

    @property
    def duration(self) -> float:
        """Time from the first to the last frame [s]."""
        return float(self.timestamps[-1] - self.timestamps[0]) if self.n_frames else 0.0

    @property
    def metadata(self) -> dict[str, Any]:
        """What was done and what is to be known, as plain values."""
        return {
            "units": self.units,
            "axes": list(self.axes),
            "operations": [dict(item) for item in self.operations],
            "notes": list(self.notes),
        }

    def track_ratios(self) -> NDArray[np.float64]:
        """Return the fraction of frames in which each point is there, filled or not, (N,)."""
        ratios: NDArray[np.float64] = (self.observed > 0).mean(axis=0)
        return ratios

    def __len__(self) -> int:
        return self.n_features

    # --- choosing ----------------------------------------------------------------------------

    def select_features(self, mask: ArrayLike) -> TrajectorySet:
        """Return the points where `mask` (N,) is true, or those of these indices, in order.

        Raises
        ------
        ConfigError
            When the mask has another length, an index is out of range, or nothing is left.
        """
        return self._points(point_mask(mask, self.n_features), "select_features")

    def select_tracked(self, min_ratio: float = 0.6) -> TrajectorySet:
        """Return the points that are there in at least this fraction of the frames."""
        chosen = self.track_ratios() >= min_ratio
        return self._points(
            point_mask(chosen, self.n_features), "select_tracked", min_ratio=float(min_ratio)
        )

    def select_moving(self, snr: float = 3.0) -> TrajectorySet:
        """Return the points whose motion exceeds `snr` times its one-sigma; see `motion_snr`."""
        chosen = self.motion_snr() > snr
        return self._points(point_mask(chosen, self.n_features), "select_moving", snr=float(snr))

    def trim(self, start_time: float | None = None, end_time: float | None = None) -> TrajectorySet:
        """Return the frames from `start_time` to `end_time` [s], both included."""
        keep = np.ones(self.n_frames, dtype=bool)
        keep &= True if start_time is None else self.timestamps >= start_time
        keep &= True if end_time is None else self.timestamps <= end_time
        if not keep.any():
            raise ConfigError(
                f"no frame between {start_time} and {end_time} s",
                expected=f"times from {self.timestamps[0]:g} to {self.timestamps[-1]:g} s",
                fix="correct the interval",
                key="trim",
            )
        rows = np.flatnonzero(keep)
        return self._take("trim", (rows,), start_time=start_time, end_time=end_time)

    def _points(self, index: NDArray[np.intp], operation: str, **settings: Any) -> TrajectorySet:
        return self._take(operation, (slice(None), index), kept=len(index), **settings)

    def _take(self, operation: str, selection: tuple[Any, ...], **settings: Any) -> TrajectorySet:
        names = ("positions", "status", "observed", "quality", "sigma", "template", "positions_px")
        changes: dict[str, Any] = {
            name: getattr(self, name)[selection]
            for name in names
            if getattr(self, name) is not None
        }
        if len(selection) == 2:
            changes["feature_ids"] = self.feature_ids[selection[1]]
        else:
            changes["timestamps"] = self.timestamps[selection[0]]
        return self._after(operation, changes, **settings)

    def _after(
        self, operation: str, changes: dict[str, Any], *, note: str = "", **settings: Any
    ) -> TrajectorySet:
        changes["operations"] = (*self.operations, {"operation": operation, **settings})
        if note:
            changes["notes"] = (*self.notes, note)
        return replace(self, **changes)

    # --- gaps, smoothing, clocks -----------------------------------------------------------------

    def fill_gaps(
        self, method: gaps.GapMethod = "linear", max_gap: int | None = None
    ) -> TrajectorySet:
        """Fill gaps between two measurements; see `openprc.vision.trajectories.gaps.fill_gaps`.

        What was measured stays as it is. Gaps longer than `max_gap` frames, and those before the
        first and after the last measurement of a point, stay NaN. Filled points have status
        INTERPOLATED and `observed` 2; their sigma grows with the time from the measurements.
        """
        made = gaps.fill_gaps(
            self.positions, self.timestamps, method=method, max_gap=max_gap, sigma=self.sigma
        )
        status, observed = self.status.copy(), self.observed.copy()
        status[made.filled], observed[made.filled] = Status.INTERPOLATED, FILLED
        count = int(made.filled.sum())
        left = f"; {made.n_left} longer ones stay open" if made.n_left else ""
        note = f"{made.n_gaps} gaps ({count} positions) were filled, {method}{left}"
        return self._after(
            "fill_gaps",
            {"positions": made.positions, "sigma": made.sigma, "status": status,
             "observed": observed},
            note=note if made.n_gaps or made.n_left else "",
            method=method, max_gap=max_gap, gaps=made.n_gaps, positions=count, left=made.n_left,
        )  # fmt: skip

    def smooth(
        self,
        window: int = 5,
        method: smoothing.SmoothingMethod = "mean",
        *,
        polyorder: int = 2,
    ) -> TrajectorySet:
        """Smooth inside gap-free runs; see `openprc.vision.trajectories.smoothing.smooth`.

        A moving average of 5 frames takes 35 % off a motion at a tenth of the frame rate;
        ``method="savgol"`` takes 1 %.
        """
        made = smoothing.smooth(
            self.positions, self.timestamps, window=window, method=method, polyorder=polyorder,
            sigma=self.sigma,
        )  # fmt: skip
        settings: dict[str, Any] = {"window": int(window), "method": method}
        if method == "savgol":
            settings["polyorder"] = int(polyorder)
        short = f"{made.n_short} runs are shorter than the smoothing window of {window} frames"
        changes = {"positions": made.positions, "sigma": made.sigma}
        return self._after("smooth", changes, note=short if made.n_short else "", **settings)

    def resample(
        self,
        rate: float | None = None,
        *,
        times: ArrayLike | None = None,
        method: resampling.ResamplingMethod = "cubic",
    ) -> TrajectorySet:
        """Interpolate to an even clock of `rate` Hz, or to `times` [s]; nothing is extrapolated.

        See `openprc.vision.trajectories.resampling.resample`. Quality and template are those of
        the frame before; raw pixel positions are dropped.
        """
        if (rate is None) == (times is None):
            raise ConfigError(
                "both a rate and times" if rate is not None else "neither a rate nor times",
                expected="one of them",
                fix="give the rate in Hz",
                key="rate",
            )
        clock = resampling.even_clock(self.timestamps, float(rate)) if times is None else times
        made = resampling.resample(
            self.positions, self.observed, self.timestamps, clock, method=method, sigma=self.sigma
        )
        status = self.status[made.source].copy()
        status[made.observed == FILLED] = Status.INTERPOLATED
        there = (Status.TRACKED, Status.INTERPOLATED, Status.REFERENCE)
        status[(made.observed == MISSING) & np.isin(status, there)] = Status.LOST
        changes = {
            "positions": made.positions, "observed": made.observed, "sigma": made.sigma,
            "status": status, "timestamps": np.asarray(clock, dtype=np.float64),
            "quality": None if self.quality is None else self.quality[made.source],
            "template": None if self.template is None else self.template[made.source],
            "positions_px": None,
        }  # fmt: skip
        settings = {"rate": rate} if times is None else {"instants": len(made.source)}
        return self._after("resample", changes, method=method, **settings)

    # --- signals -----------------------------------------------------------------------------

    def to_signals(
        self,
        dim: int = 2,
        component: str = "x",
        *,
        reference: NDArray[np.float64] | None = None,
        axis: str | None = None,
    ) -> NDArray[np.float64]:
        """Return signals for a readout [units]; what is missing stays NaN.

        Parameters
        ----------
        dim : {1, 2, 3}
            1: one component, (T, N). 2: x and y, (T, N, 2). 3: x, y and z, (T, N, 3); of planar
            positions x, y and the distance from the reference position.
        component : {"x", "y", "z", "magnitude", "path"}
            For ``dim=1``; see `openprc.vision.trajectories.signals.component`.
        reference : (N, D) [units], optional
            By default where each point was first seen.
        axis : str, optional
            Older name of `component`.
        """
        if dim == 1:
            return signals.component(self.positions, axis or component, reference=reference)
        if dim == 2:
            return self.positions[:, :, :2].copy()
        if dim == 3:
            if self.dims == 3:
                return self.positions.copy()
            far = signals.component(self.positions, "magnitude", reference=reference)
            return np.concatenate([self.positions, far[..., np.newaxis]], axis=2)
        raise ConfigError(f"dim is {dim!r}", expected="1, 2 or 3", fix="2 gives x and y", key="dim")

    def velocities(self) -> NDArray[np.float64]:
        """Return velocities, (T, N, D) [units/s]; see `signals.velocities` for the formula."""
        return signals.velocities(self.positions, self.timestamps)

    def speeds(self) -> NDArray[np.float64]:
        """Return speeds, (T, N) [units/s]."""
        speeds: NDArray[np.float64] = np.linalg.norm(self.velocities(), axis=2)
        return speeds

    # --- motion ------------------------------------------------------------------------------

    def motion_snr(self) -> NDArray[np.float64]:
        """Return the rms displacement over the one-sigma of each point, (N,).

        See `openprc.vision.trajectories.motion.motion_snr`.
        """
        return motion.motion_snr(self.positions, self.sigma)

    def remove_camera_motion(
        self, static: ArrayLike | None = None, *, model: motion.MotionModel = "rigid"
    ) -> TrajectorySet:
        """Take off the motion that the points of `static` have in common.

        See `openprc.vision.trajectories.motion.camera_motion`.
        """
        still = None if static is None else point_mask(static, self.n_features)
        made = motion.camera_motion(self.positions, still, model=model)
        note = (
            f"the {model} motion of {len(made.static)} still points ({made.removed:.3g} "
            f"{self.units} rms) was taken off; {made.residual:.3g} {self.units} rms is left"
        )
        if made.n_unknown:
            note += f"; in {made.n_unknown} frames too few of them are seen: all points missing"
        marks, status = self.observed.copy(), self.status.copy()
        lost = np.isnan(made.positions).any(axis=2) & (marks > 0)
        marks[lost], status[lost] = MISSING, Status.LOST
        return self._after(
            "remove_camera_motion",
            {"positions": made.positions, "observed": marks, "status": status},
            note=note, model=model, static=self.feature_ids[made.static].tolist(),
            residual=made.residual,
        )  # fmt: skip

    # --- files -------------------------------------------------------------------------------

    def to_simulation(self, path: str | Path, **settings: Any) -> Path:
        """Write a simulation.h5 for a reservoir.

        `settings` are those of `openprc.vision.storage.export.to_simulation`: min_ratio, max_gap,
        method, bars, velocities and overwrite.
        """
        from openprc.vision.storage.export import to_simulation  # noqa: PLC0415 - a circle

        return to_simulation(self, path, **settings)
