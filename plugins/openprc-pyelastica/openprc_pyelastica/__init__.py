"""PyElastica as a source of trajectories: reads what the callbacks of a script saved."""

from openprc.hooks import ExtensionSpec, OptionSpec, ProducerSpec, hookimpl

OPENPRC_PLUGIN_API = "1.0"

_OPTIONS = (
    OptionSpec(
        "axes",
        "Which axis of a sample holds x, y, z: first (3n, as PyElastica keeps it) or last (n3).",
        default="auto",
        choices=("auto", "3n", "n3"),
    ),
    OptionSpec("rods", "Names of the rods to import; all when left out.", multiple=True),
    OptionSpec(
        "diverged",
        "What to do with a simulation that blew up: refuse it, cut it off, or import it all.",
        default="error",
        choices=("error", "trim", "keep"),
    ),
    OptionSpec(
        "input",
        "Key of the array that drove the rod, one row a sample; none for no drive. When left "
        "out, an array called u, input, inputs, drive or forcing is taken.",
    ),
    OptionSpec("input_unit", "Unit of the drive.", default="arb"),
    OptionSpec("dt", "Seconds between samples, for files without times.", kind="float"),
    OptionSpec("position", "Key of the node positions, when it has an unusual name."),
    OptionSpec("time", "Key of the times, when it has an unusual name."),
    OptionSpec("unit", "Length unit of the script.", default="m", choices=("m", "cm", "mm")),
    OptionSpec(
        "plane",
        "Plane of a planar run; the third axis, along which nothing moves, is left out.",
        choices=("xy", "xz", "yz"),
    ),
    OptionSpec(
        "channels",
        "Stored quantities (sigma, kappa, ...) to offer as channels instead of keeping them "
        "below /extensions.",
        multiple=True,
    ),
    OptionSpec(
        "parts",
        "Whether NAME_00.npz is read together with NAME_01.npz, ... (all) or alone (one).",
        default="all",
        choices=("all", "one"),
    ),
    OptionSpec(
        "gaps",
        "What to do when a numbered part is missing: refuse, or import with a hole in time.",
        default="error",
        choices=("error", "keep"),
    ),
)


@hookimpl
def openprc_producers() -> list[ProducerSpec]:
    """Offer the importer."""
    return [
        ProducerSpec(
            name="pyelastica",
            summary="Cosserat rods: recordings of PyElastica scripts (pickles, .npz, parts)",
            load="openprc_pyelastica.importer:Importer",
            capabilities=("import",),
            suffixes=(".npz", ".dat", ".pkl", ".pickle"),
            magic=(b"PK\x03\x04", b"\x80\x04", b"\x80\x05", b"\x80\x03", b"\x80\x02"),
            dims=(2, 3),
            elements=("nodes", "bars", "rods"),
            options=_OPTIONS,
            trusts_pickle=True,
            citation="Gazzola et al. 2018, doi:10.1098/rsos.171628; "
            "Naughton et al. 2021, doi:10.1109/LRA.2021.3063698",
            sample="openprc_pyelastica.samples:write_sample",
        )
    ]


@hookimpl
def openprc_extensions() -> list[ExtensionSpec]:
    """Offer the check of the plugin's own subtree."""
    return [
        ExtensionSpec(
            name="openprc-pyelastica",
            summary="Cosserat quantities as PyElastica saved them",
            load="openprc_pyelastica.extension:check",
        )
    ]
