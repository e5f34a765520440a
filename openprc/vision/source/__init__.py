"""Where frames come from, and when each of them was taken."""

from openprc.vision.source.arrays import ArraySource
from openprc.vision.source.frame import Frame
from openprc.vision.source.opening import open_source
from openprc.vision.source.time_axis import Drop, TimeAxis
from openprc.vision.source.video_source import VideoSource

__all__ = ["ArraySource", "Drop", "Frame", "TimeAxis", "VideoSource", "open_source"]
