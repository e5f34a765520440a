"""What this package itself brings, registered by the same hooks as everybody's plugins."""

from __future__ import annotations

from openprc.hooks.hookspecs import hookimpl
from openprc.hooks.specs import (
    BenchmarkSpec,
    DetectorSpec,
    ExporterSpec,
    ExtensionSpec,
    FeatureSpec,
    OptionSpec,
    ProducerSpec,
    ReadoutSpec,
    TaskSpec,
)

OPENPRC_PLUGIN_API = "1.0"

_FEATURES = "openprc.reservoir.features."

#: Options of the producer ``vision``; `openprc.vision.import_settings` reads them.
_VISION_OPTIONS = (
    OptionSpec("detector", "How points are found: shi-tomasi, sift, orb, akaze, or your own",
               default="shi-tomasi"),
    OptionSpec("max_points", "Most points to track", kind="int", default=100),
    OptionSpec("spacing", "Least distance between detected points in px; half a window",
               kind="float"),
    OptionSpec("points", "CSV of x,y in px to track instead of detected points", kind="path"),
    OptionSpec("mask", "Image, white where points may be detected", kind="path"),
    OptionSpec("reference_frame", "Frame in which points are placed, from 0", kind="int",
               default=0),
    OptionSpec("refine", "icgn: sub-pixel matching to a template; none: plain Lucas-Kanade",
               default="icgn", choices=("icgn", "none")),
    OptionSpec("subset", "Side of the matched window in px, odd", kind="int", default=21),
    OptionSpec("model", "What a window may do: auto, quadratic, affine, translation",
               default="auto", choices=("auto", "quadratic", "affine", "translation")),
    OptionSpec("win_size", "Side of the Lucas-Kanade window in px", kind="int", default=21),
    OptionSpec("levels", "Pyramid levels above the full image, or auto", default="auto"),
    OptionSpec("fb_threshold", "Largest forward-backward distance in px", kind="float",
               default=0.2),
    OptionSpec("fps", "Frames per second, instead of the container's times", kind="float"),
    OptionSpec("value_range", "LOW,HIGH of recordings deeper than 8 bits"),
    OptionSpec("strict", "Refuse damaged recordings instead of noting it", kind="bool",
               default=False),
    OptionSpec("calibration", "File of openprc calibrate, or of OpenCV", kind="path"),
    OptionSpec("scale_bar", "x1,y1,x2,y2,LENGTH UNIT: two points in px a known length apart"),
    OptionSpec("y_up", "Turn the y axis of the calibration up", kind="bool", default=False),
    OptionSpec("stabilise", "Take off what still points show the camera to have moved",
               kind="bool", default=False),
    OptionSpec("min_ratio", "Leave out points found in a smaller fraction of the frames",
               kind="float", default=0.0),
    OptionSpec("moving", "Leave out points whose motion is below so many sigma; 0: none",
               kind="float", default=0.0),
    OptionSpec("max_gap", "Fill gaps of up to so many frames, marked as filled", kind="int",
               default=0),
    OptionSpec("smooth", "Savitzky-Golay window in frames, odd; 0: none", kind="int", default=0),
    OptionSpec("rate", "Resample to an even clock of so many Hz", kind="float"),
    OptionSpec("bars", "CSV of pairs of points whose distance becomes a bar", kind="path"),
    OptionSpec("drive", "CSV of what drove the body", kind="path"),
    OptionSpec("drive_hold", "Duration of a symbol of the drive in s", kind="float"),
    OptionSpec("drive_start", "When the drive begins, in s after the first frame", kind="float"),
    OptionSpec("drive_unit", "Unit of the drive"),
    OptionSpec("drive_quantity", "What was prescribed, such as force or voltage"),
    OptionSpec("drive_marker", "Number or x,y of a point whose displacement is the input"),
    OptionSpec("keep_marker", "The marker is a node, too", kind="bool", default=False),
)  # fmt: skip


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
            elements=("nodes", "bars", "hinges", "bends", "contact", "gravity", "damping",
                      "position-actuators", "force-actuators", "velocity-actuators"),
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
            summary="Video: points tracked to hundredths of a pixel, with quality and one-sigma",
            load="openprc.vision.producer:VisionProducer",
            capabilities=("import",),
            suffixes=(".avi", ".mp4", ".mkv", ".mov", ".mpg", ".mpeg", ".webm", ".m4v", ".y4m",
                      ".wmv", ".ts", ".cih", ".mraw"),
            needs={"import": ("cv2",)},
            install="pip install opencv-python-headless",
            dims=(2,),
            options=_VISION_OPTIONS,
            sample="openprc.vision.samples:write_sample",
        ),
    ]  # fmt: skip


@hookimpl
def openprc_exporters() -> list[ExporterSpec]:
    """Plain formats."""
    stride = OptionSpec("stride", "Take every so many frames", kind="int", default=1)
    return [
        ExporterSpec(
            name="csv",
            summary="One row a frame: time, positions, channels, inputs",
            load="openprc.exporters.csv_table:CsvExporter",
            suffixes=(".csv",),
            options=(stride,),
        ),
        ExporterSpec(
            name="npz",
            summary="Everything as plain NumPy arrays, with units beside them",
            load="openprc.exporters.npz_arrays:NpzExporter",
            suffixes=(".npz",),
            options=(
                stride,
                OptionSpec("compress", "Deflate the arrays", kind="bool", default=False),
            ),
        ),
    ]


@hookimpl
def openprc_features() -> list[FeatureSpec]:
    """State matrices from nodes, bars and channels."""
    rows = (
        ("node-positions", "Positions of chosen nodes and axes", "node_features:NodePositions"),
        ("node-displacements", "Positions relative to a reference node or to the rest state",
         "node_features:NodeDisplacements"),
        ("bar-lengths", "Length of every bar", "bar_features:BarLengths"),
        ("bar-extensions", "Length minus rest length of every bar", "bar_features:BarExtensions"),
        ("node-velocities", "Stored velocities of nodes", "node_features:NodeVelocities"),
        ("bar-strains", "Extension over rest length of every bar", "bar_features:BarStrains"),
        ("hinge-angles", "Dihedral angle of every hinge", "element_features:HingeAngles"),
        ("channels", "Columns of the recorded channels", "channel_features:Channels"),
        ("inputs", "What drove the body, as states", "input_features:Inputs"),
    )  # fmt: skip
    return [FeatureSpec(name, summary, _FEATURES + load) for name, summary, load in rows]


@hookimpl
def openprc_readouts() -> list[ReadoutSpec]:
    """Linear readouts."""
    return [
        ReadoutSpec("ridge", "Ridge regression", "openprc.reservoir.readout.ridge:Ridge"),
        ReadoutSpec(
            "least-squares",
            "Least squares by QR, for states whose useful directions are tiny",
            "openprc.reservoir.readout.least_squares:LeastSquares",
        ),
        ReadoutSpec(
            "temporal-ridge",
            "Ridge regression whose penalty is chosen on folds of time",
            "openprc.reservoir.readout.temporal_ridge:TemporalRidgeCV",
        ),
        ReadoutSpec("rls", "Recursive least squares, online", "openprc.reservoir.readout.rls:RLS"),
    ]


@hookimpl
def openprc_tasks() -> list[TaskSpec]:
    """Functions of the input, tasks that bring their own, and movements that feed themselves."""
    rows = (
        ("narma", "NARMA system of order 2 to 10, 20 or 30", "narma:NarmaTask",
         "Atiya & Parlos 2000, doi:10.1109/72.846741"),
        ("delay-recall", "The input some symbols ago", "recall:DelayRecallTask",
         "Jaeger 2002, GMD Report 152"),
        ("parity", "Parity of consecutive binary symbols; XOR by default", "recall:ParityTask",
         "Bertschinger & Natschlaeger 2004, doi:10.1162/089976604323057443"),
        ("volterra", "Second-order Volterra series with a Gaussian kernel",
         "volterra:VolterraTask", "Hauser et al. 2011, doi:10.1007/s00422-012-0471-0"),
        ("channel-equalization", "Symbols sent through a nonlinear noisy channel",
         "equalization:ChannelEqualizationTask",
         "Jaeger & Haas 2004, doi:10.1126/science.1091277"),
        ("mackey-glass", "Mackey-Glass series, 84 steps ahead", "prediction:mackey_glass_task",
         "Mackey & Glass 1977, doi:10.1126/science.267326"),
        ("lorenz", "First coordinate of the Lorenz system, one step ahead",
         "prediction:lorenz_task",
         "Lorenz 1963, doi:10.1175/1520-0469(1963)020<0130:DNF>2.0.CO;2"),
        ("henon", "Henon map, one step ahead", "prediction:henon_task",
         "Henon 1976, doi:10.1007/BF01608556"),
        ("sine-square", "Whether a period is of a sine or of a square wave",
         "waveforms:SineSquareTask", "after Paquot et al. 2012, doi:10.1038/srep00287"),
        ("inverse-arm", "Torques of a two-link arm from the path of its tip", "arm:InverseArmTask",
         "after Hauser et al. 2011, doi:10.1007/s00422-012-0471-0"),
        ("van-der-pol", "Van der Pol limit cycle in closed loop", "limit_cycles:VanDerPolTask",
         "Hauser et al. 2012, doi:10.1007/s00422-012-0516-4"),
        ("quadratic-limit-cycle", "Quadratic limit cycle in closed loop",
         "limit_cycles:QuadraticLimitCycleTask",
         "Hauser et al. 2012, doi:10.1007/s00422-012-0516-4"),
        ("lissajous", "Lissajous figure in closed loop", "limit_cycles:LissajousTask",
         "Hauser et al. 2012, doi:10.1007/s00422-012-0516-4"),
    )  # fmt: skip
    return [
        TaskSpec(name, summary, f"openprc.analysis.tasks.{load}", citation=citation)
        for name, summary, load, citation in rows
    ]


@hookimpl
def openprc_benchmarks() -> list[BenchmarkSpec]:
    """Tasks, capacities and diagnosis."""
    rows = (
        ("narma", "Error on a NARMA task beside the errors of the input alone",
         "narma_benchmark:NARMABenchmark"),
        ("memory", "Memory capacity and information processing capacity",
         "memory_benchmark:MemoryBenchmark"),
        ("dimension", "Ranks, condition number and principal components of the states",
         "diagnosis:DimensionBenchmark"),
        ("kernel-quality", "How far back states echo the input, and the kernel rank",
         "diagnosis:KernelQualityBenchmark"),
        ("input-correlation", "Which states follow the input, at which lag, and how",
         "diagnosis:InputCorrelation"),
    )  # fmt: skip
    return [
        BenchmarkSpec(name, summary, f"openprc.analysis.benchmarks.{load}")
        for name, summary, load in rows
    ]


@hookimpl
def openprc_detectors() -> list[DetectorSpec]:
    """Point detectors of OpenCV."""
    rows = (
        ("gftt", "Corners by the smaller eigenvalue (Shi-Tomasi)", "ShiTomasi"),
        ("sift", "Scale-invariant blobs", "Sift"),
        ("orb", "Oriented FAST corners", "Orb"),
        ("akaze", "Blobs in a nonlinear scale space", "Akaze"),
    )
    return [DetectorSpec(n, s, f"openprc.vision.detection.detectors:{c}") for n, s, c in rows]


@hookimpl
def openprc_extensions() -> list[ExtensionSpec]:
    """What the tracker keeps of every point."""
    return [
        ExtensionSpec(
            name="openprc-vision",
            summary="Quality, sigma, status and template of tracked points",
            load="openprc.vision.storage.extension:check",
        )
    ]
