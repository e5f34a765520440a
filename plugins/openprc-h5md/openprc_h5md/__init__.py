"""H5MD trajectories as OpenPRC trajectories, and the other way."""

from __future__ import annotations

from openprc.hooks import ExporterSpec, OptionSpec, ProducerSpec, hookimpl

OPENPRC_PLUGIN_API = "1.0"

CITATION = (
    "P. de Buyl, P. H. Colberg, F. Hoefling (2014), H5MD: a structured, efficient, and portable "
    "file format for molecular data, Comput. Phys. Commun. 185:1546, "
    "doi:10.1016/j.cpc.2014.01.018"
)


@hookimpl
def openprc_producers() -> list[ProducerSpec]:
    """Return the importer of H5MD files."""
    return [
        ProducerSpec(
            name="h5md",
            summary="H5MD files: particles, their bonds, and observables",
            load="openprc_h5md.importer:H5mdImporter",
            capabilities=("import",),
            suffixes=(".h5md", ".h5", ".hdf5"),
            magic=(b"\x89HDF\r\n\x1a\n",),
            dims=(2, 3),
            time=("physical", "pseudo"),
            elements=("nodes", "bars"),
            options=(
                OptionSpec("group", "name below /particles, where there are several"),
                OptionSpec(
                    "unit",
                    "unit of the positions where the file does not say",
                    choices=("m", "cm", "mm", "um", "nm", "Angstrom", "px", "arb"),
                ),
                OptionSpec(
                    "time_unit",
                    "unit of time where the file does not say; 1 for steps without a duration",
                    choices=("s", "ms", "us", "ns", "ps", "fs", "1"),
                ),
                OptionSpec(
                    "wrapped",
                    "keep positions of a periodic box as they are, jumps at its walls included",
                    kind="bool",
                    default=False,
                ),
            ),
            citation=CITATION,
            sample="openprc_h5md.samples:write_sample",
        )
    ]


@hookimpl
def openprc_exporters() -> list[ExporterSpec]:
    """Return the exporter to H5MD."""
    return [
        ExporterSpec(
            name="h5md",
            summary="H5MD 1.1, for MDAnalysis, VMD and whoever reads HDF5",
            load="openprc_h5md.exporter:H5mdExporter",
            citation=CITATION,
            suffixes=(".h5md",),
            options=(
                OptionSpec("stride", "take every so many frames", kind="int", default=1),
                OptionSpec(
                    "unit",
                    "unit of the positions; readers of molecules know Angstrom and nm only",
                    default="Angstrom",
                    choices=("Angstrom", "nm", "stored"),
                ),
                OptionSpec(
                    "bonds", "which elements become bonds, if there are such", default="bars"
                ),
            ),
        )
    ]
