"""Points, a video, and what becomes of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from openprc.errors import ConfigError, NoFeaturesError, VideoError
from openprc.vision.source.opening import open_source
from openprc.vision.source.time_axis import TimeAxis
from openprc.vision.tracking.config import KLTConfig
from openprc.vision.tracking.plain_klt import PlainKLT
from openprc.vision.tracking.predictor import inside
from openprc.vision.tracking.result import TrackingResult
from openprc.vision.tracking.track_steps import Follower, FrameTracks

if TYPE_CHECKING:
    from openprc.vision.detection.feature_map import FeatureMap
    from openprc.vision.source.frame import Frame
    from openprc.vision.source.video_source import VideoSource


class Tracker:
    """Follows the features of one frame through a video.

    Parameters
    ----------
    source : VideoSource, or what `openprc.vision.source` can open
    features : FeatureMap, or (N, 2) [px]
        The points, as they lie in the reference frame.
    config : KLTConfig, optional
    reference_frame : int, optional
        The frame in which the points lie; that of the feature map, or 0, where left out.
        Frames before it are followed backward as far as they fit into memory
        (`KLTConfig.backward_memory`).
    progress : callable, optional
        Called with the number of frames done and the number declared (None if unknown).

    Raises
    ------
    NoFeaturesError
        There is no point.
    ConfigError
        A point lies outside the image, or the feature map belongs to another frame or to a
        video of another size.
    """

    def __init__(
        self,
        source: VideoSource | str | Path,
        features: FeatureMap | ArrayLike,
        *,
        config: KLTConfig | None = None,
        reference_frame: int | None = None,
        progress: Callable[[int, int | None], None] | None = None,
    ) -> None:
        self.source = open_source(source)
        self.config = config or KLTConfig()
        self.progress = progress
        self.points = _points(features, tuple(self.source.shape))
        self.reference_frame = _reference(features, reference_frame, tuple(self.source.shape))
        self._follower: Follower | None = None
        self._notes: list[str] = []
        self._n_empty = 0
        self._empty_since: int | None = None

    @property
    def notes(self) -> tuple[str, ...]:
        """What the user should know, of the frames followed so far."""
        return (*self._notes, *(self._follower.notes if self._follower else ()))

    @property
    def noise(self) -> float:
        """One-sigma of the image noise [grey levels], NaN where not known."""
        return float(getattr(self._follower, "noise", np.nan))

    def steps(self) -> Iterator[FrameTracks]:
        """Yield all points in every frame, in order, holding no more than a few frames.

        Raises
        ------
        VideoError
            The video ends before the reference frame.
        NoFeaturesError
            A source that is `strict`, and all points are lost for good.
        """
        self._notes = []
        self._follower = None
        self._n_empty, self._empty_since = 0, None
        before: list[Frame] = []
        room = self.config.backward_memory * 2**20
        done = 0
        total = self.source.frame_count or None
        for frame in self.source.frames():
            if frame.index < self.reference_frame:
                before.append(frame)
                size = frame.grey.nbytes + (frame.intensity is not frame.grey) * (
                    frame.intensity.nbytes
                )
                if len(before) * size > room:
                    # Frames too many to be kept are given out unseen, oldest first.
                    yield FrameTracks.unseen(before.pop(0), len(self.points))
                    done += 1
                continue
            if self._follower is None:
                for step in self._backward(frame, before, unseen=done):
                    yield step
                    done += 1
                before.clear()
                self._follower = _follower(self.config)
                step = self._follower.place(frame, self.points)
            else:
                step = self._follower.step(frame)
            done += 1
            self._count(step)
            if self.progress is not None:
                self.progress(done, total)
            yield step
        self._tell_of_empty_frames()
        if self._follower is None:
            raise VideoError(
                f"the video ends after {done + len(before)} frames",
                expected=f"the reference frame {self.reference_frame}",
                fix="choose an earlier reference frame",
                file=self.source.path or self.source.name,
                key="reference_frame",
            )

    def _count(self, step: FrameTracks) -> None:
        """Keep account of the frames in which no point was found."""
        if np.isfinite(step.positions[:, 0]).any():
            self._empty_since = None
        else:
            self._n_empty += 1
            if self._empty_since is None:
                self._empty_since = step.index

    def _tell_of_empty_frames(self) -> None:
        if not self._n_empty:
            return
        text = f"no point was found in {self._n_empty} frames"
        if self._empty_since is None:
            self._notes.append(f"{text}; points came back after each of them")
            return
        text += f", among them frame {self._empty_since} and all after it"
        if self.source.strict:
            raise NoFeaturesError(
                text,
                expected="points that come back, as strict=True asks",
                fix="end the recording before, choose other points, or leave strict out",
                file=self.source.path or self.source.name,
            )
        self._notes.append(text)

    def _backward(self, reference: Frame, before: list[Frame], *, unseen: int) -> list[FrameTracks]:
        """Follow the points backward through the frames `before` the reference."""
        if unseen:
            self._notes.append(
                f"the first {unseen} of {self.reference_frame} frames before the reference frame "
                f"do not fit into {self.config.backward_memory:g} MB (backward_memory) and were "
                "not followed: all points are LOST in them"
            )
        if not before:
            return []
        follower = _follower(self.config)
        follower.place(reference, self.points)
        found = [follower.step(frame) for frame in reversed(before)]
        first, last = before[0].index, before[-1].index
        which = f"frames {first} to {last} were" if last > first else f"frame {first} was"
        self._notes.append(
            f"{which} followed backward from the reference frame {self.reference_frame}"
        )
        return found[::-1]

    def run(self, *, on_interrupt: Literal["raise", "keep"] = "raise") -> TrackingResult:
        """Follow the points to the end of the video.

        Parameters
        ----------
        on_interrupt : "raise" or "keep"
            With "keep", Ctrl-C ends the run and what is finished is returned, with a note.
        """
        steps: list[FrameTracks] = []
        stopped: tuple[str, ...] = ()
        try:
            for step in self.steps():
                steps.append(step)
        except KeyboardInterrupt:
            if on_interrupt == "raise" or not steps:
                raise
            stopped = (f"interrupted: the tracks end after frame {steps[-1].index}",)
        if not steps:
            raise VideoError(
                "the video delivers no frame",
                expected="at least the reference frame",
                fix="check the file",
                file=self.source.path or self.source.name,
            )
        stamps = np.array([step.stamp for step in steps])
        duplicated = tuple(step.index for step in steps if step.duplicate)
        if stopped:
            # What is missing was not read, which is no fault of the recording.
            axis = TimeAxis.from_stamps(
                stamps,
                declared_fps=self.source.fps,
                fps=self.source.asked_fps,
                duplicated=duplicated,
            )
        else:
            axis = self.source.time_axis(stamps, duplicated=duplicated)
        return TrackingResult.from_steps(
            steps,
            timestamps=axis.times,
            time_axis=axis,
            reference_frame=self.reference_frame,
            noise=self.noise,
            config=self.config,
            frame_shape=self.source.shape,
            notes=(*self.notes, *stopped),
        )


def _follower(config: KLTConfig) -> Follower:
    if config.refine == "none":
        return PlainKLT(config)
    # Compiled numerics: not before they are needed.
    from openprc.vision.tracking.refined_tracks import RefinedTracks  # noqa: PLC0415

    return RefinedTracks(config)


def _points(features: FeatureMap | ArrayLike, shape: tuple[int, ...]) -> NDArray[np.float64]:
    points = np.array(getattr(features, "keypoints", features), dtype=np.float64)
    if points.size == 0:
        raise NoFeaturesError(
            "there is no point to follow",
            expected="at least one feature",
            fix="detect with a lower threshold or another method (gftt), or give points",
            key="features",
        )
    if points.ndim != 2 or points.shape[1] != 2:
        raise ConfigError(
            f"the points have the shape {points.shape}",
            expected="(N, 2): x and y in px",
            fix="give one row for each point",
            key="features",
        )
    wrong = np.flatnonzero(~inside(points, shape))
    if len(wrong):
        x, y = points[wrong[0]]
        raise ConfigError(
            f"point {wrong[0]} lies at ({x:g}, {y:g}), and {len(wrong)} of {len(points)} lie "
            "outside the image",
            expected=f"x from 0 to {shape[1] - 1}, y from 0 to {shape[0] - 1} px",
            fix="leave them out, or exchange x and y",
            key="features",
        )
    return points


def _reference(features: FeatureMap | ArrayLike, asked: int | None, shape: tuple[int, ...]) -> int:
    found_in = getattr(features, "ref_frame_index", None)
    size = getattr(features, "frame_shape", None)
    if size is not None and tuple(size[:2]) != shape[:2]:
        raise ConfigError(
            f"the features were found in an image of {size[1]} x {size[0]} px",
            expected=f"{shape[1]} x {shape[0]} px, as the video has",
            fix="detect the features in this video",
            key="features",
        )
    if asked is None:
        return int(found_in or 0)
    if asked < 0 or int(asked) != asked:
        raise ConfigError(
            f"reference_frame is {asked}",
            expected="a whole number from 0",
            fix="take 0, the first frame",
            key="reference_frame",
        )
    if found_in is not None and found_in != asked:
        raise ConfigError(
            f"the features were found in frame {found_in}, and reference_frame is {asked}",
            expected="one and the same frame",
            fix="detect the features in the reference frame",
            key="reference_frame",
        )
    return int(asked)
