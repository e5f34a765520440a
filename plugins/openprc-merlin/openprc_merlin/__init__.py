"""MERLIN, MERLIN2 and Sim-FAST runs, and FOLD animations, to and from OpenPRC trajectories."""

from __future__ import annotations

from openprc.hooks import ExporterSpec, ExtensionSpec, OptionSpec, ProducerSpec, hookimpl

OPENPRC_PLUGIN_API = "1.0"

_OPTIONS = (
    OptionSpec(
        "reference",
        "file with the rest coordinates (N x 3: mat, h5, obj, npz, csv) for a run saved without",
        kind="path",
    ),
    OptionSpec("unit", "length unit of the run; MERLIN stores none", choices=("m", "cm", "mm")),
    OptionSpec(
        "force-unit", "force unit of the run; MERLIN stores none", choices=("N", "mN", "kN")
    ),
    OptionSpec("dt", "seconds per increment, which makes the time physical", kind="float"),
    OptionSpec(
        "time",
        "'increment', or the name of a variable that holds the instants in seconds",
        default="increment",
    ),
    OptionSpec("displacement", "name of the displacement history, where it cannot be told"),
    OptionSpec("load", "name of the load history, or 'none' to leave it out"),
    OptionSpec(
        "stored",
        "keep MERLIN's own strains, angles and energies in the extension",
        kind="bool",
        default=False,
    ),
    OptionSpec(
        "verify",
        "recompute the balance of forces of every increment and note the residual",
        kind="bool",
        default=False,
    ),
    OptionSpec("c0", "modulus C0 of the bars, where the file does not tell it", kind="float"),
)

RUN_OPTIONS = (
    OptionSpec(
        "control",
        "what is controlled: auto takes displacement where driven positions move, else arc-length",
        default="auto",
        choices=("auto", "arc-length", "displacement", "load"),
    ),
    OptionSpec(
        "increments", "increments along the arc; by default one a frame of the run", kind="int"
    ),
    OptionSpec(
        "initial-load-factor",
        "load factor that the first increment aims at; by default that of the force signals at "
        "the first frame after rest",
        kind="float",
    ),
    OptionSpec(
        "arc-length",
        "length of the first increment [m], over all degrees of freedom, instead of its load",
        kind="float",
    ),
    OptionSpec("max-load", "load factor, up or down, that ends the path", kind="float"),
    OptionSpec("max-displacement", "displacement of a node [m] that ends the path", kind="float"),
    OptionSpec(
        "tolerance",
        "length of a correction, in median bar lengths, below which an increment has converged",
        kind="float",
        default=1e-6,
    ),
    OptionSpec(
        "max-iterations",
        "iterations before a step is halved; by default 15 along an arc, 50 otherwise",
        kind="int",
    ),
    OptionSpec(
        "min-step",
        "share of the first step below which the search is given up",
        kind="float",
        default=1e-6,
    ),
    OptionSpec(
        "unstable",
        "at unstable states: follow them, settle on the minimum downhill, or stop",
        default="follow",
        choices=("follow", "settle", "stop"),
    ),
)

_FOLD_OPTIONS = (
    OptionSpec(
        "unit", "length unit, where the file does not say one", choices=("m", "cm", "mm", "um")
    ),
    OptionSpec("dt", "seconds per frame, which makes the time physical", kind="float"),
    OptionSpec(
        "time",
        "'increment' to number the frames, or the key of the frames that holds their instants in "
        "seconds; by default openprc:time where it is there",
    ),
)


@hookimpl
def openprc_producers() -> list[ProducerSpec]:
    """Return the origami programs and the format they share."""
    return [
        ProducerSpec(
            name="merlin",
            summary="Quasi-static bars and hinges; MERLIN, MERLIN2 and Sim-FAST workspaces and OBJ",
            load="openprc_merlin.producer:Producer",
            capabilities=("run", "import"),
            suffixes=(".mat", ".h5", ".hdf5", ".obj"),
            magic=(b"MATLAB 5.0 MAT-file", b"MATLAB 7.3 MAT-file", b"\x89HDF\r\n\x1a\n"),
            needs={"import": ("scipy",), "run": ("scipy",)},
            install="pip install scipy",
            dims=(2, 3),
            time=("pseudo", "physical"),
            elements=(
                *("nodes", "bars", "hinges", "bends", "faces", "gravity"),
                *("position-actuators", "force-actuators"),
            ),
            options=_OPTIONS,
            run_options=RUN_OPTIONS,
            citation=(
                "K. Liu, G. H. Paulino (2017), Proc. R. Soc. A 473:20170348, "
                "doi:10.1098/rspa.2017.0348; K. Liu, G. H. Paulino (2018), Origami 7"
            ),
            sample="openprc_merlin.samples:write_sample",
        ),
        ProducerSpec(
            name="fold",
            summary="FOLD 1.2 files with several frames (.fold): origami animations",
            load="openprc_merlin.fold_importer:FoldImporter",
            capabilities=("import",),
            suffixes=(".fold",),
            dims=(2, 3),
            time=("pseudo", "physical"),
            elements=("nodes", "bars", "hinges", "faces"),
            options=_FOLD_OPTIONS,
            citation="E. D. Demaine, J. S. Ku, R. J. Lang (2016), FOLD, github.com/edemaine/fold",
            sample="openprc_merlin.fold_sample:write_sample",
        ),
    ]


_STRIDE = OptionSpec("stride", "keep every so many frames", kind="int", default=1)
_MERLIN_EXPORT = (
    OptionSpec(
        "version",
        "names of MERLIN (1) or MERLIN2 (2); by default those the run came with, else 2",
        choices=("1", "2"),
    ),
    OptionSpec(
        "rest",
        "'stored', or 'first' where frame 0 is free of stress",
        choices=("stored", "first"),
        default="stored",
    ),
    OptionSpec("compress", "compress the variables", kind="bool", default=True),
    _STRIDE,
)


@hookimpl
def openprc_exporters() -> list[ExporterSpec]:
    """Return the exporters to origami programs."""
    return [
        ExporterSpec(
            name="merlin",
            summary="Workspace of MERLIN or MERLIN2 (.mat): input, model and histories",
            load="openprc_merlin.exporter:MerlinExporter",
            citation="K. Liu, G. H. Paulino (2017), doi:10.1098/rspa.2017.0348",
            suffixes=(".mat",),
            needs=("scipy",),
            install="pip install scipy",
            options=_MERLIN_EXPORT,
        ),
        ExporterSpec(
            name="fold",
            summary="FOLD 1.2 animation (.fold): edges, assignments and fold angles",
            load="openprc_merlin.fold_exporter:FoldExporter",
            citation="E. D. Demaine, J. S. Ku, R. J. Lang (2016), FOLD, github.com/edemaine/fold",
            options=(_STRIDE,),
        ),
    ]


@hookimpl
def openprc_extensions() -> list[ExtensionSpec]:
    """Return the subtree that holds what the file contract has no place for."""
    return [
        ExtensionSpec(
            name="openprc-merlin",
            summary="Increment numbers, solver generation, supports and stored results of MERLIN",
            load="openprc_merlin.extension:check",
        )
    ]
