"""What it costs to list the installed plugins, beyond importing `openprc.hooks`.

    python benchmarks/plugin_listing.py [--repeat 11] [--json FILE]

A fresh interpreter imports `openprc.hooks`, and then collects every installed plugin into a
registry. Given is the processor time of the second step and of its parts (medians over fresh
interpreters that take turns), and its ratio to importing numpy, which any use of a file takes
next, in the same round. The limit that is aimed at is 50 ms. The floor is what reading the
metadata of the installed distributions takes, which `importlib.metadata` does for anybody.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
from pathlib import Path

from rich.console import Console
from rich.table import Table

LIMIT = 50.0  # ms
_BEGIN = "import sys, time, openprc.hooks; from openprc.hooks.registry import Registry\n"
_CODES = {
    "all plugins": _BEGIN + "t = time.process_time(); r = Registry()\n",
    "no plugin": _BEGIN + "t = time.process_time(); Registry([])\n",
    "entry points": "import time, importlib.metadata as m\nt = time.process_time()\n"
    "list(m.entry_points(group='openprc'))\n",
    "import numpy": "import time; t = time.process_time(); import numpy\n",
}
_END = "print(1e3 * (time.process_time() - t))\n"
_NAMES = _BEGIN + (
    "before = set(sys.modules); r = Registry(); new = set(sys.modules) - before\n"
    "import json; print(json.dumps([[p.name, p.state] for p in r.plugins]))\n"
    "print(json.dumps(sorted({n.partition('.')[0] for n in new})))\n"
)


def said(code: str) -> list[str]:
    """Return the lines that a fresh interpreter prints."""
    done = subprocess.run([sys.executable, "-c", code], check=True, capture_output=True, text=True)
    return done.stdout.splitlines()


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--repeat", type=int, default=11)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    times: dict[str, list[float]] = {name: [] for name in _CODES}
    for _ in range(options.repeat):
        for name, code in _CODES.items():
            times[name].append(float(said(code + _END)[-1]))
    medians = {name: statistics.median(values) for name, values in times.items()}
    plugins, modules = (json.loads(line) for line in said(_NAMES))
    table = Table("what", "ms of processor time", "x import numpy", title="Listing plugins")
    for name, median in medians.items():
        table.add_row(name, f"{median:.1f}", f"{median / medians['import numpy']:.2f}")
    console = Console()
    console.print(table)
    share = medians["all plugins"] / LIMIT
    console.print(f"{len(plugins)} plugins; {share:.0%} of the limit of {LIMIT:g} ms")
    console.print(f"imported besides: {', '.join(modules)}")
    if options.json:
        found = {"ms": medians, "plugins": plugins, "imported": modules, "limit": LIMIT}
        options.json.write_text(json.dumps(found, indent=2) + "\n")


if __name__ == "__main__":
    main()
