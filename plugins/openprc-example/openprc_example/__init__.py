"""A plugin for OpenPRC to copy from: trajectories in CSV files.

This module is all that is imported to list the plugin, so it imports records and nothing else;
the code that a record names is loaded when it is used.
"""

from openprc.hooks import ExporterSpec, FeatureSpec, OptionSpec, ProducerSpec, hookimpl

OPENPRC_PLUGIN_API = "1.0"


@hookimpl
def openprc_producers() -> list[ProducerSpec]:
    """Return the producer ``csv``."""
    return [
        ProducerSpec(
            name="csv",
            summary="Node positions and sensor readings in a CSV or TSV file",
            load="openprc_example.importer:CsvImporter",
            capabilities=("import",),
            suffixes=(".csv", ".tsv"),
            dims=(2, 3),
            time=("physical", "pseudo"),
            elements=("nodes",),
            options=(
                OptionSpec("unit", "unit of the coordinates where the header does not say"),
                OptionSpec("dt", "time between two rows, in the unit of time", kind="float"),
                OptionSpec("input", "column that drove the body", multiple=True, default=()),
                OptionSpec("hold", "how long one input symbol was held", kind="float"),
            ),
            sample="openprc_example.samples:write_sample",
        )
    ]


@hookimpl
def openprc_exporters() -> list[ExporterSpec]:
    """Return the exporter ``xyz``."""
    return [
        ExporterSpec(
            name="xyz",
            summary="Extended XYZ: one block of text a frame, for OVITO, ASE or VMD",
            load="openprc_example.exporter:XyzExporter",
            suffixes=(".xyz", ".extxyz"),
            options=(
                OptionSpec("stride", "take every so many frames", kind="int", default=1),
                OptionSpec("species", "what every node is called", default="X"),
            ),
        )
    ]


@hookimpl
def openprc_features() -> list[FeatureSpec]:
    """Return the feature ``node-speeds``."""
    return [
        FeatureSpec(
            name="node-speeds",
            summary="Speed of every node",
            load="openprc_example.features:NodeSpeeds",
        )
    ]
