"""Video to trajectory: detect, track, calibrate, save; and the built-in producer ``vision``.

The public names are resolved on first use: nothing here imports OpenCV or a compiler until a
video is opened.

>>> import openprc.vision as vision
>>> src = vision.VideoSource("clip.mp4")
>>> fmap = vision.FeatureMapCache(src).get_or_detect(src.read_frame(0), method="gftt")
>>> result = vision.Tracker(src, fmap.top_n(100)).run()
>>> tset = vision.TrajectorySet.from_tracking_result(result)
>>> vision.save("clip.h5", source=src, tracking_result=result, trajectory_set=tset)
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from openprc.vision.calibration.camera import CameraCalibration
    from openprc.vision.calibration.normalized import NormalizedCalibration, auto_calibration
    from openprc.vision.calibration.planar import PlanarTarget
    from openprc.vision.calibration.scale_bar import ScaleBar
    from openprc.vision.calibration.stereo import StereoRig
    from openprc.vision.detection.cache import FeatureMapCache
    from openprc.vision.detection.feature_map import FeatureMap
    from openprc.vision.detection.registry import detect, get_detector, register_detector
    from openprc.vision.source.arrays import ArraySource
    from openprc.vision.source.frame import Frame
    from openprc.vision.source.time_axis import TimeAxis
    from openprc.vision.source.video_source import VideoSource
    from openprc.vision.storage.loading import load
    from openprc.vision.storage.outline import info
    from openprc.vision.storage.saving import save
    from openprc.vision.tracking.config import KLTConfig
    from openprc.vision.tracking.result import TrackingResult
    from openprc.vision.tracking.status import Status
    from openprc.vision.tracking.tracker import Tracker
    from openprc.vision.trajectories.trajectory_set import TrajectorySet

_LAZY = {
    "VideoSource": "openprc.vision.source.video_source",
    "ArraySource": "openprc.vision.source.arrays",
    "Frame": "openprc.vision.source.frame",
    "TimeAxis": "openprc.vision.source.time_axis",
    "FeatureMap": "openprc.vision.detection.feature_map",
    "FeatureMapCache": "openprc.vision.detection.cache",
    "detect": "openprc.vision.detection.registry",
    "get_detector": "openprc.vision.detection.registry",
    "register_detector": "openprc.vision.detection.registry",
    "KLTConfig": "openprc.vision.tracking.config",
    "Tracker": "openprc.vision.tracking.tracker",
    "TrackingResult": "openprc.vision.tracking.result",
    "Status": "openprc.vision.tracking.status",
    "NormalizedCalibration": "openprc.vision.calibration.normalized",
    "CameraCalibration": "openprc.vision.calibration.camera",
    "ScaleBar": "openprc.vision.calibration.scale_bar",
    "PlanarTarget": "openprc.vision.calibration.planar",
    "StereoRig": "openprc.vision.calibration.stereo",
    "auto_calibration": "openprc.vision.calibration.normalized",
    "TrajectorySet": "openprc.vision.trajectories.trajectory_set",
    "save": "openprc.vision.storage.saving",
    "load": "openprc.vision.storage.loading",
    "info": "openprc.vision.storage.outline",
}

__all__ = [
    "ArraySource",
    "CameraCalibration",
    "FeatureMap",
    "FeatureMapCache",
    "Frame",
    "KLTConfig",
    "NormalizedCalibration",
    "PlanarTarget",
    "ScaleBar",
    "Status",
    "StereoRig",
    "TimeAxis",
    "Tracker",
    "TrackingResult",
    "TrajectorySet",
    "VideoSource",
    "auto_calibration",
    "detect",
    "get_detector",
    "info",
    "load",
    "register_detector",
    "save",
]


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        return getattr(import_module(_LAZY[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted(__all__)
