"""What this package itself brings, registered by the same hooks as everybody's plugins."""

from __future__ import annotations

from openprc.hooks.hookspecs import hookimpl
from openprc.hooks.specs import (
    BenchmarkSpec,
    DetectorSpec,
    FeatureSpec,
    OptionSpec,
    ProducerSpec,
    ReadoutSpec,
    TaskSpec,
)

OPENPRC_PLUGIN_API = "1.0"

_FEATURES = "openprc.reservoir.features."


@hookimpl
def openprc_producers() -> list[ProducerSpec]:
    """The native engine, the video tracker, and the reader of older files."""
    return [
        ProducerSpec(
            name="demlat",
            summary="Native bar-hinge engine: runs an experiment folder",
            load="openprc.demlat.producer:DemlatProducer",
            capabilities=("run",),
            needs={"run": ("numba",)},
            install="pip install numba",
            elements=("nodes", "bars", "hinges", "gravity", "damping", "position-actuators",
                      "force-actuators"),
            sample="openprc.demlat.samples:write_sample",
        ),
        ProducerSpec(
            name="legacy",
            summary="Files of the older 0.1 packages: simulations, lab recordings, vision files",
            load="openprc.schema.legacy:LegacyImporter",
            capabilities=("import",),
            suffixes=(".h5", ".hdf5", ".json"),
            options=(OptionSpec("unit", "Unit of length, where the file does not state it"),),
        ),
        ProducerSpec(
            name="vision",
            summary="Video: points detected in the first frame and tracked by optical flow",
            load="openprc.vision.producer:VisionProducer",
            capabilities=("import",),
            suffixes=(".avi", ".mp4", ".mkv", ".mov", ".mpg", ".mpeg", ".webm", ".m4v"),
            needs={"import": ("cv2",)},
            install="pip install opencv-python-headless",
            dims=(2,),
            options=(
                OptionSpec("detector", "How points are found in the first frame",
                           default="shi-tomasi", choices=("shi-tomasi", "sift", "orb", "akaze")),
                OptionSpec("fps", "Frames per second, instead of the container's times",
                           kind="float"),
                OptionSpec("max_points", "Most points to track", kind="int", default=100),
                OptionSpec("points", "CSV of x,y in px to track instead", kind="path"),
                OptionSpec("win_size", "Side of the tracking window in px", kind="int", default=21),
                OptionSpec("levels", "Pyramid levels above the full image", kind="int", default=3),
                OptionSpec("fb_threshold", "Largest forward-backward distance in px", kind="float",
                           default=1.0),
            ),
            sample="openprc.vision.samples:write_sample",
        ),
    ]  # fmt: skip


@hookimpl
def openprc_features() -> list[FeatureSpec]:
    """State matrices from nodes, bars and channels."""
    rows = (
        ("node-positions", "Positions of chosen nodes and axes", "node_features:NodePositions"),
        ("node-displacements", "Positions relative to a reference node or to the rest state",
         "node_features:NodeDisplacements"),
        ("bar-lengths", "Length of every bar", "bar_features:BarLengths"),
        ("bar-extensions", "Length minus rest length of every bar", "bar_features:BarExtensions"),
        ("channels", "Columns of the recorded channels", "channel_features:Channels"),
    )  # fmt: skip
    return [FeatureSpec(name, summary, _FEATURES + load) for name, summary, load in rows]


@hookimpl
def openprc_readouts() -> list[ReadoutSpec]:
    """Linear readouts."""
    return [
        ReadoutSpec("ridge", "Ridge regression", "openprc.reservoir.readout.ridge:Ridge"),
    ]


@hookimpl
def openprc_tasks() -> list[TaskSpec]:
    """Imitation tasks."""
    return [
        TaskSpec(
            "narma",
            "Nonlinear autoregressive moving average of order 2, 5, 10, 20 or 30",
            "openprc.analysis.tasks.imitation:NARMA_task",
            citation="Atiya & Parlos 2000, doi:10.1109/72.846741",
        ),
    ]


@hookimpl
def openprc_benchmarks() -> list[BenchmarkSpec]:
    """Task-level benchmarks."""
    return [
        BenchmarkSpec(
            "narma",
            "Error on a NARMA task beside the error of a shift register",
            "openprc.analysis.benchmarks.narma_benchmark:NARMABenchmark",
        ),
    ]


@hookimpl
def openprc_detectors() -> list[DetectorSpec]:
    """Point detectors of OpenCV."""
    rows = (
        ("shi-tomasi", "Corners by the smaller eigenvalue", "ShiTomasi"),
        ("sift", "Scale-invariant blobs", "Sift"),
        ("orb", "Oriented FAST corners", "Orb"),
        ("akaze", "Blobs in a nonlinear scale space", "Akaze"),
    )
    return [DetectorSpec(n, s, f"openprc.vision.detectors:{c}") for n, s, c in rows]
