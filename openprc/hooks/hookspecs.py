"""Every hook of OpenPRC, on one page.

A hook takes no arguments and returns an iterable of records (`openprc.hooks.specs`). It is
called once, at discovery; it is never a callback into a run. A plugin module looks like this::

    from openprc.hooks import ProducerSpec, hookimpl

    OPENPRC_PLUGIN_API = "1.0"

    @hookimpl
    def openprc_producers():
        return [ProducerSpec(name="pendulum", summary="A pendulum in a text file",
                             load="openprc_pendulum.importer:PendulumImporter",
                             capabilities=("import",), suffixes=(".pend",))]

and is named by an entry point of the group ``openprc``.
"""

from __future__ import annotations

from collections.abc import Iterable

import pluggy

from openprc.hooks.specs import (
    BenchmarkSpec,
    DetectorSpec,
    ExporterSpec,
    ExtensionSpec,
    FeatureSpec,
    ProducerSpec,
    ReadoutSpec,
    TaskSpec,
)

#: Entry point group that names plugin modules.
GROUP = "openprc"
#: MAJOR.MINOR of the plugin contract. A plugin states the version that it was written for.
PLUGIN_API = "1.0"

hookspec = pluggy.HookspecMarker(GROUP)
hookimpl = pluggy.HookimplMarker(GROUP)


@hookspec
def openprc_producers() -> Iterable[ProducerSpec]:
    """Sources of trajectories: simulators to run, recorders to attach, files to import.

    ::

        return [ProducerSpec(name="csv", summary="Node positions in a CSV file",
                             load="openprc_example.importer:CsvImporter",
                             capabilities=("import",), suffixes=(".csv",))]
    """
    raise NotImplementedError


@hookspec
def openprc_exporters() -> Iterable[ExporterSpec]:
    """Writers of other formats.

    ::

        return [ExporterSpec(name="xyz", summary="Extended XYZ, one block a frame",
                             load="openprc_example.exporter:XyzExporter")]
    """
    raise NotImplementedError


@hookspec
def openprc_features() -> Iterable[FeatureSpec]:
    """Trajectory to (T, F) state matrix with column names.

    ::

        return [FeatureSpec(name="node-speeds", summary="Speed of every node",
                            load="openprc_example.features:NodeSpeeds")]
    """
    raise NotImplementedError


@hookspec
def openprc_readouts() -> Iterable[ReadoutSpec]:
    """Estimators in the manner of scikit-learn.

    ::

        return [ReadoutSpec(name="ridge", summary="Ridge regression",
                            load="openprc.reservoir.readout.ridge:Ridge")]
    """
    raise NotImplementedError


@hookspec
def openprc_tasks() -> Iterable[TaskSpec]:
    """Input sequence to target sequence.

    ::

        return [TaskSpec(name="narma", summary="NARMA of order 2 to 10, 20 or 30",
                         load="openprc.analysis.tasks.narma:NarmaTask")]
    """
    raise NotImplementedError


@hookspec
def openprc_benchmarks() -> Iterable[BenchmarkSpec]:
    """States and input to named numbers.

    ::

        return [BenchmarkSpec(name="narma", summary="Error on a NARMA task",
                              load="openprc.analysis.benchmarks.narma_benchmark:NARMABenchmark")]
    """
    raise NotImplementedError


@hookspec
def openprc_detectors() -> Iterable[DetectorSpec]:
    """Image to points, for the video tracker.

    ::

        return [DetectorSpec(name="orb", summary="Oriented FAST corners",
                             load="openprc.vision.detection.detectors:Orb")]
    """
    raise NotImplementedError


@hookspec
def openprc_extensions() -> Iterable[ExtensionSpec]:
    """A distribution's own subtree ``/extensions/<distribution>``, with its check.

    ::

        return [ExtensionSpec(name="openprc-merlin", summary="Load history as stored",
                              load="openprc_merlin.extension:check")]
    """
    raise NotImplementedError


#: Hook name to the record type that it must return.
RECORDS: dict[str, type] = {
    "openprc_producers": ProducerSpec,
    "openprc_exporters": ExporterSpec,
    "openprc_features": FeatureSpec,
    "openprc_readouts": ReadoutSpec,
    "openprc_tasks": TaskSpec,
    "openprc_benchmarks": BenchmarkSpec,
    "openprc_detectors": DetectorSpec,
    "openprc_extensions": ExtensionSpec,
}
