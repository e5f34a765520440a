"""What the checks let a fresh interpreter do: ``python -m openprc.testing.isolated``.

The order stands on standard input as JSON: which plugin, which packages are to look as if they
were not installed, and a sample to import. The answer is JSON on standard output.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

from openprc.errors import MissingDependency, OpenPRCError, PluginError
from openprc.hooks.importing import import_file
from openprc.hooks.registry import Registered, Registry
from openprc.schema.trajectory import Trajectory
from openprc.testing.lookup import ModuleEntry


def main() -> None:
    """Do what is asked for and print what came of it."""
    order = json.loads(sys.stdin.read())
    for name in order.get("absent", ()):
        # As if it were not installed: import statements fail, and find_spec() finds nothing.
        sys.modules[name] = None  # type: ignore[assignment]
    entries = [ModuleEntry(order["module"], order["distribution"], order["version"])]
    registry = Registry([] if order["distribution"] == "openprc" else entries, wanted=None)
    item = registry.find(order["hook"], f"{order['distribution']}/{order['name']}")
    answer: dict[str, Any]
    try:
        answer = {"digest": _do(order, item, registry)}
    except OpenPRCError as error:
        answer = {
            **error.as_dict(),
            "missing": isinstance(error, MissingDependency),
            "foreign": type(error) is PluginError,
        }
    sys.stdout.write("\n" + json.dumps(answer) + "\n")


def _do(order: dict[str, Any], item: Registered, registry: Registry) -> str:
    registry.load(item, capability=order["capability"])
    if "sample" not in order:
        return ""
    out = Path(order["out"])
    import_file(
        Path(order["sample"]),
        out,
        as_name=item.qualified_name,
        options={k: tuple(v) if isinstance(v, list) else v for k, v in order["options"].items()},
        trust=order["trust"],
        registry=registry,
    )
    with Trajectory(out) as trajectory:
        return trajectory.content_digest()


if __name__ == "__main__":
    main()
