"""Distance correlation and HSIC next to other packages: the same numbers, taking turns.

    python benchmarks/dependence_speed.py --peer-python PATH [--rounds 5] [--quick] [--json FILE]

PATH is the Python of an environment into which the peers were installed::

    pip install openprc==0.1.1 dcor==0.7

"upstream" is that openprc. Everybody runs in a process of its own on one thread and takes turns
in every round; times are CPU time, medians over rounds, and of a ratio the median over rounds of
the ratio within a round. Calls go through the public classes, checks included; "a channel of 20"
is a twentieth of a call with twenty channels, which share the work on the input. "first" is the
first call, compiled but without memory from earlier ones, in ms: large matrices cost more then.
The difference is that from our value. The limit is what any method on sorted data pays: sorting
both series. Memory is what the first call adds to the largest resident size of the process.

One series is normal, the other its square with noise, 13 rows later.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

CHANNELS = 20
BLOCK_S = 0.2  # CPU time that a block of calls should take
MOST_CALLS = 200
OURS, SHARED, UPSTREAM = "openprc", "openprc, a channel of 20", "upstream"
THREADS = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")

#: A contestant: what runs it, and up to which n, beyond which it takes minutes or gigabytes.
DCOR = {
    OURS: ("ours", 10**9),
    SHARED: ("ours_shared", 10**9),
    "dcor avl": ("dcor_avl", 10**9),
    "dcor mergesort": ("dcor_mergesort", 10**9),
    "dcor naive": ("dcor_naive", 3000),
    UPSTREAM: ("upstream_dcor", 10_000),
    "sorting both": ("sort", 10**9),
}
HSIC = {
    OURS: ("hsic", 10**9),
    SHARED: ("hsic_shared", 10**9),
    UPSTREAM: ("upstream_hsic", 2000),
}
TESTS = {
    "openprc dcor, 199 circular shifts": ("dcor_shift_test", 10**9),
    "openprc dcor, 199 permutations": ("dcor_permutation_test", 10**9),
    "dcor, 199 permutations": ("peer_permutation_test", 1000),
    "openprc HSIC, all circular shifts and lags": ("hsic_profile", 10**9),
}
OWN = {"ours", "ours_shared", "hsic", "hsic_shared", "sort", "hsic_profile"}
OWN |= {"dcor_shift_test", "dcor_permutation_test"}


def series(n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the input (n,) and channels (n, 20)."""
    rng = np.random.default_rng(n)
    x = rng.normal(size=n)
    late = np.roll(x, 13)[:, None] ** 2
    return x, late + 0.5 * rng.normal(size=(n, CHANNELS))


# --- what the processes do ---------------------------------------------------------------------


def contestant(name: str, x: np.ndarray, Y: np.ndarray) -> Callable[[], float]:
    """Return one call, for the interpreter that has the package."""
    y = np.ascontiguousarray(Y[:, 0])
    if name == "sort":
        return lambda: float(np.sort(x)[0] + np.sort(y)[0])
    if name in OWN:
        return _ours(name, x, Y)
    if name.startswith("upstream"):
        from openprc.analysis.correlation import Nonparametric  # noqa: PLC0415 - in one process

        if name == "upstream_dcor":
            return lambda: float(Nonparametric(x, y[:, None]).dcor.values[0])
        return lambda: float(Nonparametric(x, y[:, None]).hsic().values[0])
    import dcor  # noqa: PLC0415 - in one process only

    if name == "peer_permutation_test":
        from dcor.independence import distance_covariance_test  # noqa: PLC0415

        def test() -> float:
            rng = np.random.default_rng(0)
            return float(distance_covariance_test(x, y, num_resamples=199, random_state=rng).pvalue)

        return test
    method = name.removeprefix("dcor_")
    return lambda: float(dcor.distance_correlation(x, y, method=method))


def _ours(name: str, x: np.ndarray, Y: np.ndarray) -> Callable[[], float]:
    from openprc.analysis.correlation import Nonparametric  # noqa: PLC0415 - in one process only

    y = np.ascontiguousarray(Y[:, 0])
    calls = {
        "ours": lambda: Nonparametric(x, y).dcor.values[0],
        "ours_shared": lambda: Nonparametric(x, Y).dcor.values[0],
        "hsic": lambda: Nonparametric(x, y).hsic.values[0],
        "hsic_shared": lambda: Nonparametric(x, Y).hsic.values[0],
        "dcor_shift_test": lambda: Nonparametric(x, y).dcor.p_values[0],
        "dcor_permutation_test": lambda: Nonparametric(x, y, null="permutation").dcor.p_values[0],
        "hsic_profile": lambda: Nonparametric(x, y, max_lag=500).hsic_profile.p_values[0, 513],
    }
    return lambda: float(calls[name]())


def serve(name: str, n: int) -> None:
    """Answer with the value and the memory, then with the CPU time of as many calls as told."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)  # whatever a package says belongs elsewhere
    call = contestant(name, *series(n))
    small = contestant(name, *series(1200))
    small()  # compiles
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    began = time.process_time()
    value = call()
    first = time.process_time() - began
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before
    answers.write(json.dumps({"value": value, "memory_kb": memory, "first_s": first}) + "\n")
    answers.flush()
    for line in sys.stdin:
        began = time.process_time()
        for _ in range(int(line)):
            call()
        answers.write(json.dumps({"cpu_s": time.process_time() - began}) + "\n")
        answers.flush()


# --- what asks them ----------------------------------------------------------------------------


class Contestant:
    """A process that answers."""

    def __init__(self, module: str, n: int, peer_python: Path | None) -> None:
        self.reason, self.child = "", None
        python = Path(sys.executable) if module in OWN else peer_python
        if python is None:
            self.reason = "no --peer-python was given"
            return
        environment = {**os.environ, **THREADS}
        if module not in OWN:
            # Another package by the name openprc must not be found first.
            environment.pop("PYTHONPATH", None)
        self.child = subprocess.Popen(
            [python, Path(__file__).resolve(), "--serve", module, str(n)],
            cwd=Path(__file__).parent,
            env=environment,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        first = self._answer()
        self.value, self.memory_kb = first.get("value"), first.get("memory_kb")
        self.first_s = first.get("first_s")
        if self.reason:
            return
        once = self.seconds(1)
        self.calls = int(np.clip(BLOCK_S / max(once, 1e-6), 1, MOST_CALLS))

    def seconds(self, calls: int) -> float:
        """Return the CPU time of one of so many calls [s]."""
        assert self.child is not None
        assert self.child.stdin is not None
        self.child.stdin.write(f"{calls}\n")
        self.child.stdin.flush()
        return self._answer().get("cpu_s", float("nan")) / calls

    def close(self) -> None:
        """End the process."""
        if self.child is not None:
            self.child.communicate()

    def _answer(self) -> dict[str, Any]:
        assert self.child is not None
        assert self.child.stdout is not None
        line = self.child.stdout.readline()
        if not line:
            self.reason = f"ended with {self.child.wait()}"
            return {}
        return json.loads(line)


def compare(
    contestants: dict[str, tuple[str, int]], n: int, *, peer_python: Path | None, rounds: int
) -> list[dict[str, Any]]:
    """Let them take turns; return one row each."""
    there = {
        name: Contestant(module, n, peer_python)
        for name, (module, most) in contestants.items()
        if n <= most
    }
    times: dict[str, list[float]] = {name: [] for name, c in there.items() if not c.reason}
    for _ in range(rounds):
        for name in times:
            share = CHANNELS if name == SHARED else 1
            times[name].append(there[name].seconds(there[name].calls) / share)
    for c in there.values():
        c.close()
    first = next(iter(there))
    rows = []
    for name, c in there.items():
        row: dict[str, Any] = {"n": n, "name": name, "skipped": c.reason}
        if not c.reason:
            within = [a / b for a, b in zip(times[name], times[first], strict=True)]
            row |= {
                "ms": 1e3 * statistics.median(times[name]),
                "first_ms": 1e3 * c.first_s / (CHANNELS if name == SHARED else 1),
                "over_ours": statistics.median(within),
                "value": c.value,
                "difference": abs(c.value - there[first].value),
                "memory_mb": c.memory_kb / 1024,
            }
            if SHARED in times:
                shared = [a / b for a, b in zip(times[name], times[SHARED], strict=True)]
                row["over_shared"] = statistics.median(shared)
        rows.append(row)
    return rows


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--peer-python", type=Path, metavar="PATH")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--quick", action="store_true", help="leave out n = 10,000 of upstream")
    parser.add_argument("--json", type=Path, metavar="FILE")
    parser.add_argument("--serve", nargs=2, metavar=("NAME", "N"), help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.serve:
        serve(options.serve[0], int(options.serve[1]))
        return
    # The peers' environment need not have it.
    from rich.console import Console  # noqa: PLC0415
    from rich.table import Table  # noqa: PLC0415

    if options.peer_python is not None:
        # Peers start in another folder; a link stays a link, or it would leave its environment.
        options.peer_python = options.peer_python.absolute()
        if not options.peer_python.is_file():
            parser.error(f"--peer-python: there is no {options.peer_python}")
    dcor = dict(DCOR)
    if options.quick:
        dcor[UPSTREAM] = (DCOR[UPSTREAM][0], 3000)
    report: dict[str, list[dict[str, Any]]] = {}
    for title, contestants, sizes in (
        ("Distance correlation", dcor, (1000, 10_000, 100_000)),
        ("HSIC", HSIC, (1000, 2000, 10_000)),
        ("Tests", TESTS, (1000, 5000)),
    ):
        table = Table(title=title, title_justify="left")
        for heading in ("n", "", "first", "ms", "x ours", "x 1 of 20", "difference", "MB"):
            table.add_column(heading, justify="left" if not heading else "right")
        rows = report[title] = []
        for n in sizes:
            # A peer that takes seconds is no more certain for being asked often.
            found = compare(
                contestants,
                n,
                peer_python=options.peer_python,
                rounds=options.rounds if n < 10_000 or options.quick else min(options.rounds, 3),
            )
            rows.extend(found)
            for row in found:
                if row["skipped"]:
                    table.add_row(f"{n:,}", f"{row['name']}: {row['skipped']}")
                    continue
                same = title != "Tests" and row["name"] not in (OURS, "sorting both")
                table.add_row(
                    f"{n:,}",
                    row["name"],
                    f"{row['first_ms']:.4g}",
                    f"{row['ms']:.4g}",
                    f"{row['over_ours']:.3g}",
                    f"{row['over_shared']:.3g}" if "over_shared" in row else "-",
                    f"{row['difference']:.1e}" if same else "-",
                    f"{row['memory_mb']:.1f}",
                )
            table.add_section()
        Console(width=110).print(table)
    if options.json:
        options.json.write_text(json.dumps(report, indent=2) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
