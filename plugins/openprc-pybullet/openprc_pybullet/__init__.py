"""PyBullet as a source of trajectories: its state logs, users' files, and running scripts."""

from __future__ import annotations

from openprc.hooks import ExtensionSpec, OptionSpec, ProducerSpec, hookimpl

OPENPRC_PLUGIN_API = "1.0"

INSTALL = (
    "pip install 'pybullet>=3.2.7' (wheels: Linux x86-64, CPython 3.8 to 3.11; "
    "elsewhere pip compiles it)"
)

OPTIONS = (
    OptionSpec(
        "urdf",
        help="model of a logged body, ID=PATH (or PATH when one body is imported), for link "
        "positions, names, masses and joint units; .sdf and MJCF .xml work as well",
        multiple=True,
        default=(),
    ),
    OptionSpec(
        "urdf_flags",
        help="flags with which the script loaded the models, where they change links or masses",
        multiple=True,
        default=(),
        choices=(
            "URDF_USE_INERTIA_FROM_FILE",
            "URDF_MAINTAIN_LINK_ORDER",
            "URDF_MERGE_FIXED_LINKS",
        ),
    ),
    OptionSpec(
        "urdf_scale",
        help="globalScaling with which the script loaded the models",
        kind="float",
        default=1.0,
    ),
    OptionSpec(
        "bodies",
        help="unique ids of the bodies to import; all that move or have joints when left out",
        kind="int",
        multiple=True,
        default=(),
    ),
    OptionSpec(
        "include_static",
        help="keep bodies without joints that never move, such as the ground plane",
        kind="bool",
        default=False,
    ),
    OptionSpec(
        "dt",
        help="time step in s where the file has none (Minitaur logs, arrays without time); "
        "checked against the time stamps where there are some",
        kind="float",
    ),
    OptionSpec(
        "t0",
        help="simulation time in s at which recording began; added to every time",
        kind="float",
        default=0.0,
    ),
    OptionSpec("unit", help="unit of length in a user's own file", default="m"),
    OptionSpec(
        "time_unit",
        help="unit of time in a user's own file or in a log with columns of its own",
        default="s",
        choices=("s", "ms", "us", "min"),
    ),
    OptionSpec("position_key", help="array or key that holds the positions"),
    OptionSpec("time_key", help="array, key or column that holds the time"),
    OptionSpec("input_key", help="array, key or column that drove the body"),
    OptionSpec("input_unit", help="unit of the input", default="arb"),
    OptionSpec("input_quantity", help="what the input is, e.g. torque", default=""),
)

RUN_OPTIONS = (
    OptionSpec(
        "start",
        help="half-kick puts velocities half a step back at the start, which makes PyBullet's "
        "steps those of leapfrog, of second order; plain leaves its semi-implicit Euler",
        default="half-kick",
        choices=("half-kick", "plain"),
    ),
)


@hookimpl
def openprc_producers() -> list[ProducerSpec]:
    """Return the PyBullet producer."""
    return [
        ProducerSpec(
            name="pybullet",
            summary="PyBullet: experiments, running scripts, state logs, files with poses",
            load="openprc_pybullet.producer:Producer",
            capabilities=("import", "record", "run"),
            needs={"record": ("pybullet",), "run": ("pybullet",)},
            suffixes=(".log", ".bin", ".npz", ".pkl", ".pickle", ".csv", ".txt", ".bullet"),
            magic=(b"stepCount,timeStamp,", b"t,r,p,y,q0,", b"BULLETd", b"BT3CMD"),
            install=INSTALL,
            dims=(2, 3),
            time=("physical", "pseudo"),
            elements=(
                *("nodes", "bars", "hinges", "bends", "faces", "rigid-bodies", "soft-bodies"),
                *("joints", "contact", "gravity", "damping"),
                *("position-actuators", "force-actuators", "velocity-actuators"),
            ),
            options=OPTIONS,
            run_options=RUN_OPTIONS,
            trusts_pickle=True,
            citation="E. Coumans and Y. Bai, PyBullet, a Python module for physics simulation "
            "for games, robotics and machine learning, https://pybullet.org, 2016-2021",
            sample="openprc_pybullet.samples:write_sample",
        )
    ]


@hookimpl
def openprc_extensions() -> list[ExtensionSpec]:
    """Offer the check of the plugin's own subtree."""
    return [
        ExtensionSpec(
            name="openprc-pybullet",
            summary="Body and link of every node, names of joints",
            load="openprc_pybullet.extension:check",
        )
    ]
