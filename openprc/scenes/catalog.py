"""The scenes there are; nothing is built and nothing heavy is imported before one is asked for."""

from __future__ import annotations

import difflib
from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import Any, cast

from openprc.errors import ConfigError
from openprc.hooks.options import check_options
from openprc.hooks.specs import OptionSpec
from openprc.scenes.scene import Scene, SceneSpec

_HERE = "openprc.scenes"


def _real(name: str, text: str, default: float) -> OptionSpec:
    return OptionSpec(name, text, kind="float", default=default)


def _whole(name: str, text: str, default: int) -> OptionSpec:
    return OptionSpec(name, text, kind="int", default=default)


_SEED = _whole("seed", "Of everything that is drawn at random", 1)

SCENES: Mapping[str, SceneSpec] = MappingProxyType(
    {
        spec.name: spec
        for spec in (
            SceneSpec(
                name="oscillator",
                summary="A mass on a spring",
                needs=("nodes", "bars"),
                reference="closed form",
                load=f"{_HERE}.oscillator:build",
                options=(
                    _real("frequency", "Frequency [Hz]", 1.0),
                    _real("amplitude", "Stretch of the spring of 1 m at the start [m]", 0.1),
                    _whole("periods", "How many are simulated", 10),
                ),
            ),
            SceneSpec(
                name="damped-oscillator",
                summary="A mass on a spring with a dashpot, or in a viscous medium",
                needs=("nodes", "bars", "damping"),
                reference="closed form",
                load=f"{_HERE}.damped_oscillator:build",
                options=(
                    _real("frequency", "Frequency without damping [Hz]", 1.0),
                    _real("amplitude", "Stretch of the spring of 1 m at the start [m]", 0.1),
                    _whole("periods", "How many of that frequency are simulated", 5),
                    _real("ratio", "Damping over critical damping", 0.05),
                    OptionSpec(
                        "where", "Dashpot along the bar, or drag of the mass in a medium",
                        default="bar", choices=("bar", "medium"),
                    ),
                ),
            ),
            SceneSpec(
                name="pendulum",
                summary="A point mass on a stiff bar, swinging far",
                needs=("nodes", "bars", "gravity"),
                reference="closed form",
                load=f"{_HERE}.pendulum:build",
                options=(
                    _real("angle", "From straight down at the start [rad]", 1.5),
                    _real("length", "Of the bar [m]", 1.0),
                    _real("stiffness", "Of the bar [N/m]", 1e5),
                    _real("duration", "Simulated time [s]", 6.0),
                    OptionSpec("rigid", "The bar has a constant length", kind="bool",
                               default=False),
                ),
            ),
            SceneSpec(
                name="hanging-chain",
                summary="Point masses on links, hanging, that swing a little in one mode",
                needs=("nodes", "bars", "gravity"),
                reference="closed form",
                load=f"{_HERE}.hanging_chain:build",
                run_options={
                    # Linear tension, and next to no rotary inertia.
                    "pyelastica": {"section": "constant", "radius": 0.002, "substeps": "auto"}
                },
                options=(
                    _whole("n", "Number of masses; the chain is 1 m long and weighs 1 kg", 5),
                    _whole("mode", "Which mode, 1 is the slowest", 1),
                    _real("amplitude", "Largest displacement sideways [m]", 1e-4),
                    _real("stiffness", "Of a link [N/m]", 1e4),
                    _whole("periods", "How many are simulated", 4),
                ),
            ),
            SceneSpec(
                name="swinging-chain",
                summary="Point masses on links, let go with all links aside: chaotic",
                needs=("nodes", "bars", "gravity"),
                reference="converged",
                load=f"{_HERE}.swinging_chain:build",
                run_options={
                    "pyelastica": {"section": "constant", "radius": 0.002, "substeps": "auto"}
                },
                options=(
                    _whole("n", "Number of masses of 0.1 kg on links of 0.2 m", 5),
                    _real("angle", "Of all links from straight down at the start [rad]",
                          1.5707963267948966),
                    _real("stiffness", "Of a link [N/m]", 1e5),
                    _real("duration", "Simulated time [s]", 2.0),
                    OptionSpec("rigid", "Links have a constant length", kind="bool",
                               default=False),
                ),
            ),
            SceneSpec(
                name="cantilever",
                summary="A clamped rod of bars and bends that settles under a force at its tip",
                needs=("nodes", "bars", "bends", "damping", "force-actuators"),
                reference="closed form",
                load=f"{_HERE}.cantilever:build",
                run_options={
                    # Next to no shear, which bars do not have.
                    "pyelastica": {"shear_scale": 100.0, "substeps": "auto"},
                    # The force is there from the start; its path is not asked for.
                    "merlin": {"control": "load"},
                },
                options=(
                    _whole("n", "Number of segments; the rod is 1 m long", 10),
                    _real("force", "At the tip, downwards [N]", 0.005),
                    _real("duration", "Simulated time [s]; it rests after 20", 24.0),
                ),
            ),
            SceneSpec(
                name="von-mises-truss",
                summary="Two bars with a shallow apex that a spring presses through: snap-through",
                needs=("nodes", "bars", "position-actuators"),
                reference="closed form",
                load=f"{_HERE}.von_mises_truss:build",
                options=(
                    _real("rise", "Height of the apex over a half span of 1 m [m]; small is"
                          " shallow", 0.3),
                    _real("stiffness", "Of a bar [N/m]", 100.0),
                    _real("loader", "Stiffness of the spring that presses over the largest slope"
                          " of the truss; up to 1 the apex jumps", 10.0),
                    _real("duration", "Of the press [s]", 100.0),
                ),
            ),
            SceneSpec(
                name="spring-lattice",
                summary="A lattice of springs that a random force shakes: a reservoir for tasks",
                needs=("nodes", "bars", "damping", "force-actuators"),
                reference="converged",
                load=f"{_HERE}.spring_lattice:build",
                options=(
                    _whole("side", "Nodes along a side", 4),
                    _whole("n_symbols", "Random values of the force, 0.15 s each", 600),
                    _real("stiffness", "Mean of the springs [N/m]", 6.0),
                    _real("strength", "Force over the symbols, which are in [0, 0.5] [N]", 1.0),
                    _SEED,
                ),
            ),
            SceneSpec(
                name="hauser-network",
                summary="Random network of cubic springs and dashpots of Hauser et al. 2011",
                needs=("nodes", "bars", "damping", "force-actuators"),
                reference="converged",
                load=f"{_HERE}.hauser_network:build",
                options=(
                    _whole("n", "Number of masses", 30),
                    OptionSpec("drive", "Ranges of constants and input of that task",
                               default="volterra", choices=("volterra", "narma")),
                    _whole("n_steps", "Rows of 1 ms; published: washout 60000, training 200000,"
                           " test 15000", 100_000),
                    _SEED,
                ),
            ),
            SceneSpec(
                name="miura",
                summary="A Miura sheet, shaken for tasks, or folded slowly (variant=folding)",
                needs=("nodes", "bars", "hinges", "damping", "force-actuators"),
                reference="converged",
                load=f"{_HERE}.miura:build",
                options=(
                    OptionSpec("variant", "Shaken at an edge, or folded as MERLIN's example",
                               default="driven", choices=("driven", "folding")),
                    _whole("columns", "Cells across", 2),
                    _whole("rows", "Cells along", 2),
                    _whole("n_symbols", "driven: random values of the force, 0.1 s each", 600),
                    _real("strength", "driven: force over the symbols, which are in [0, 0.5] [N]",
                          0.5),
                    _SEED,
                    _real("duration", "folding: simulated time [s]", 20.0),
                    _real("fold", "folding: stiffness of folds [N m / rad per m]", 0.1),
                    _real("facet", "folding: stiffness of panels [N m / rad per m]", 1e4),
                ),
            ),
            SceneSpec(
                name="kresling",
                summary="A Kresling tower pressed from one state without strain into the other",
                needs=("nodes", "bars", "position-actuators"),
                reference="closed form",
                load=f"{_HERE}.kresling:build",
                options=(
                    _whole("sides", "Of the polygons", 6),
                    _real("twist", "Between bottom and top at the start [deg]", 50.0),
                    _real("height", "At the start [m]; the radius is 0.1 m", 0.175),
                    _real("duration", "Of the press [s]", 20.0),
                ),
            ),
            SceneSpec(
                name="bouncing-body",
                summary="A ball that falls on a fixed face and bounces",
                needs=("nodes", "contact", "gravity"),
                reference="closed form",
                load=f"{_HERE}.bouncing_body:build",
                options=(
                    _real("height", "That it falls from [m]", 0.5),
                    _real("restitution", "Speed after over before an impact", 0.8),
                    _whole("bounces", "How many are simulated", 3),
                ),
            ),
        )
    }
)  # fmt: skip


def find_scene(name: str) -> SceneSpec:
    """Return the record of a scene.

    Raises
    ------
    ConfigError
        When there is none of that name.
    """
    if name not in SCENES:
        near = difflib.get_close_matches(name, SCENES, n=1)
        raise ConfigError(
            f"the scene {name!r}",
            expected="one of " + ", ".join(SCENES),
            fix=f"did you mean {near[0]!r}?" if near else "see `openprc scenes`",
        )
    return SCENES[name]


def scene_options(name: str, options: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Return every option of a scene, defaults filled in and values of the stated kind.

    Raises
    ------
    ConfigError
        When the name or an option is unknown, or a value is wrong.
    """
    spec = find_scene(name)
    # Of the record only the name is used, in messages.
    return check_options(cast("Any", spec), spec.options, dict(options or {}))


def build_scene(name: str, options: Mapping[str, Any] | None = None) -> Scene:
    """Return a scene with its options, given as text or values.

    Raises
    ------
    ConfigError
        When the name or an option is unknown, or a value is wrong.
    """
    spec, values = find_scene(name), scene_options(name, options)
    module, _, function = spec.load.partition(":")
    scene: Scene = getattr(import_module(module), function)(**values)
    return scene


def write_scene(scene: Scene, folder: str | Path) -> tuple[Path, ...]:
    """Write ``input/{geometry.h5, signals.h5, config.json}`` of a scene below `folder`."""
    from openprc.schema.experiment import save_experiment  # noqa: PLC0415 - reads HDF5

    return save_experiment(scene.experiment, folder)
