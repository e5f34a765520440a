"""``openprc plugins``."""

from __future__ import annotations

import warnings
from typing import Any

import click

from openprc.cli.console import console, json_option, print_json, table
from openprc.hooks.faults import PluginWarning
from openprc.hooks.hookspecs import PLUGIN_API
from openprc.hooks.registry import NOUNS, Registry, availability


@click.command("plugins")
@click.option("--strict", is_flag=True, help="Exit with 1 when a plugin is broken.")
@json_option
@click.pass_context
def command(ctx: click.Context, strict: bool, as_json: bool) -> None:
    """List plugins, what they can do, and why some were left out.

    Nothing but the plugins' own entry modules is imported.
    """
    with warnings.catch_warnings():
        # The table tells the same, with more room.
        warnings.simplefilter("ignore", PluginWarning)
        registry = Registry()
    plugins = [
        {
            "name": plugin.name,
            "distribution": plugin.distribution,
            "version": plugin.version,
            "state": plugin.state,
            "problem": plugin.problem,
            "fix": plugin.fix,
        }
        for plugin in registry.plugins
    ]
    producers = [_producer(item) for item in registry.producers]
    others = {
        noun: [item.qualified_name for item in registry.records(hook)]
        for hook, noun in NOUNS.items()
        if hook != "openprc_producers"
    }
    if as_json:
        print_json({"plugin_api": PLUGIN_API, "plugins": plugins, "producers": producers, **others})
    else:
        _show(plugins, producers, others)
    faulty = [plugin for plugin in plugins if plugin["state"] in ("broken", "incompatible")]
    ctx.exit(1 if strict and faulty else 0)


def _producer(item: Any) -> dict[str, Any]:
    spec = item.spec
    return {
        "name": spec.name,
        "distribution": item.distribution,
        "summary": spec.summary,
        "capabilities": list(spec.capabilities),
        "suffixes": list(spec.suffixes),
        "state": availability(spec),
        "install": spec.install,
        "options": {option.name: option.help for option in spec.options},
        "run_options": {option.name: option.help for option in spec.run_options},
        "citation": spec.citation,
    }


def _show(
    plugins: list[dict[str, Any]], producers: list[dict[str, Any]], others: dict[str, list[str]]
) -> None:
    out = console()
    out.print(
        table(
            ["plugin", "distribution", "version", "state"],
            [[p["name"], p["distribution"], p["version"], p["state"]] for p in plugins],
            title=f"Plugins (API {PLUGIN_API})",
        )
    )
    for plugin in plugins:
        if plugin["problem"] and plugin["state"] != "disabled":
            out.print(f"{plugin['name']}: {plugin['problem']}", markup=False)
            out.print(f"  to do: {plugin['fix']}", markup=False)
    out.print(
        table(
            ["producer", "from", "can", "state", "what"],
            [
                [
                    p["name"],
                    p["distribution"],
                    " ".join(p["capabilities"]),
                    p["state"] if p["state"] == "ok" else f"{p['state']} ({p['install']})",
                    p["summary"],
                ]
                for p in producers
            ],
            title="Producers",
        )
    )
    for noun, names in others.items():
        if names:
            out.print(f"{noun}s: {', '.join(names)}", markup=False)
