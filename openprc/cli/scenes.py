"""``openprc scenes``."""

from __future__ import annotations

import warnings
from typing import Any

import click

from openprc.cli.console import console, json_option, print_json, table
from openprc.hooks.faults import PluginWarning
from openprc.hooks.registry import Registry, missing_packages
from openprc.scenes.catalog import SCENES, build_scene
from openprc.scenes.scene import SceneSpec


@click.command("scenes")
@click.option("--ask", is_flag=True, help="Ask every producer about every scene, which is slower.")
@json_option
def command(ask: bool, as_json: bool) -> None:
    """List the bodies of the library, what is known about them, and who can run them.

    Producers are matched by what they say that they can model; with --ask they are shown every
    body, and those that refuse it are left out.
    """
    with warnings.catch_warnings():
        # `openprc plugins` tells what is wrong with a plugin.
        warnings.simplefilter("ignore", PluginWarning)
        registry = Registry()
    rows = [_row(spec, registry, ask=ask) for spec in SCENES.values()]
    if as_json:
        print_json({"scenes": rows})
        return
    out = console()
    out.print(
        table(
            ["scene", "what", "needs", "known by", "producers with all of it", "options"],
            [
                [
                    row["name"],
                    row["summary"],
                    " ".join(row["needs"]),
                    row["reference"],
                    " ".join(row["producers"]) or "none installed",
                    " ".join(f"{o['name']}={_text(o['default'])}" for o in row["options"]),
                ]
                for row in rows
            ],
        )
    )
    out.print("openprc scene NAME --out DIR writes one; openprc scene NAME says more", markup=False)


def _row(spec: SceneSpec, registry: Registry, *, ask: bool) -> dict[str, Any]:
    return {
        "name": spec.name,
        "summary": spec.summary,
        "needs": list(spec.needs),
        "reference": spec.reference,
        "producers": _asked(spec, registry) if ask else _matching(spec, registry),
        "options": [
            {
                "name": option.name,
                "help": option.help,
                "kind": option.kind,
                "default": option.default,
                "choices": list(option.choices),
            }
            for option in spec.options
        ],
        "run_options": {name: dict(values) for name, values in spec.run_options.items()},
    }


def _matching(spec: SceneSpec, registry: Registry) -> list[str]:
    """Return installed producers whose records name everything that the scene needs."""
    return [
        item.name
        for item in registry.producers
        if "run" in item.spec.capabilities
        and not missing_packages(item.spec, "run")
        and set(spec.needs) <= set(item.spec.elements)
    ]


def _asked(spec: SceneSpec, registry: Registry) -> list[str]:
    # Loads the code of every producer.
    from openprc.scenes.requirements import producer_verdicts  # noqa: PLC0415

    verdicts = producer_verdicts(build_scene(spec.name).experiment, registry=registry)
    return [verdict.producer for verdict in verdicts if verdict.state == "runs"]


def _text(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else f"{value:g}" if isinstance(
        value, int | float
    ) else str(value)  # fmt: skip
