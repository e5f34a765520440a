"""How long the command line takes to say something, against a bare interpreter.

    python benchmarks/startup.py [--repeat 11] [--json]

Commands take turns in every round; the figures are medians, in units of ``python -c pass``,
with milliseconds for orientation.
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import time
from pathlib import Path

BIN = Path(sys.executable).parent
COMMANDS = {
    "python -c pass": [sys.executable, "-c", "pass"],
    "import click": [sys.executable, "-c", "import click"],
    "openprc --help": [str(BIN / "openprc"), "--help"],
    "openprc plugins": [str(BIN / "openprc"), "plugins"],
    "openprc plugins --json": [str(BIN / "openprc"), "plugins", "--json"],
}


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--repeat", type=int, default=11)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    seconds: dict[str, list[float]] = {name: [] for name in COMMANDS}
    for _ in range(options.repeat):
        for name, words in COMMANDS.items():
            start = time.perf_counter()
            subprocess.run(words, check=True, stdout=subprocess.DEVNULL)
            seconds[name].append(time.perf_counter() - start)
    medians = {name: statistics.median(values) for name, values in seconds.items()}
    base = medians["python -c pass"]
    rows = [
        {"what": name, "ms": 1e3 * median, "ratio": median / base}
        for name, median in medians.items()
    ]
    if options.json:
        print(json.dumps(rows, indent=2))
        return
    for row in rows:
        print(f"{row['what']:24s} {row['ms']:7.0f} ms   {row['ratio']:5.1f} x")


if __name__ == "__main__":
    main()
