"""PyElastica as a source of trajectories: recorder, runner, and reader of saved recordings."""

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


_RUN_OPTIONS = (
    OptionSpec(
        "poisson",
        "Poisson's ratio of the material, for the shear stiffness that a rod has and bars lack.",
        kind="float",
        default=0.5,
    ),
    OptionSpec(
        "shear_scale",
        "Factor on the shear stiffness: larger comes closer to bars and needs shorter steps.",
        kind="float",
        default=1.0,
    ),
    OptionSpec(
        "radius",
        "Radius [m] that sets the rotary inertia of the elements; 2 sqrt(EI/EA) when left out, "
        "a tenth of an element where nothing resists bending.",
        kind="float",
    ),
    OptionSpec(
        "section",
        "Whether a rod thins as it is drawn out, which is PyElastica's law, or keeps its section, "
        "whose tension is that of a linear bar.",
        default="thinning",
        choices=("thinning", "constant"),
    ),
    OptionSpec(
        "clamp",
        "What two fixed nodes at an end become: a held node and a held element as in "
        "OneEndFixedBC, whose shear moves the second node a little; or two held nodes.",
        default="element",
        choices=("element", "nodes"),
    ),
    OptionSpec(
        "substeps",
        "Simulation steps in one dt of the experiment: a number, or auto for as many as "
        "stability needs.",
        default="1",
    ),
)


@hookimpl
def openprc_producers() -> list[ProducerSpec]:
    """Offer importer, recorder and runner under one name."""
    return [
        ProducerSpec(
            name="pyelastica",
            summary="Cosserat rods by PyElastica: run chains, record scripts, read recordings",
            load="openprc_pyelastica.producer:Producer",
            capabilities=("import", "record", "run"),
            suffixes=(".npz", ".dat", ".pkl", ".pickle"),
            magic=(b"PK\x03\x04", b"\x80\x04", b"\x80\x05", b"\x80\x03", b"\x80\x02"),
            needs={"record": ("elastica",), "run": ("elastica",)},
            install="pip install 'pyelastica>=0.3.3,<2'",
            dims=(2, 3),
            elements=(
                "nodes",
                "bars",
                "bends",
                "rods",
                "rigid-bodies",
                "joints",
                "gravity",
                "damping",
                "position-actuators",
                "velocity-actuators",
                "force-actuators",
            ),
            options=_OPTIONS,
            run_options=_RUN_OPTIONS,
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
