"""Swing a chain on two integrators and a perturbed twin: which difference is a fault?

Two runs of one chain are a hair apart at first and far apart at the end, and neither is wrong.
The links of the third are a per cent short, and it parts from the first much too early.

python examples/07_compare.py
"""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path

from openprc.compare.chaos.judgement import judge_difference
from openprc.compare.comparison import compare_files
from openprc.compare.page.html import save_page
from openprc.compare.runs.producers import run_producers
from openprc.compare.runs.requests import read_requests
from openprc.compare.studies import Choices, compare_producers
from openprc.scenes.catalog import build_scene


def main(folder: Path) -> None:
    """Run the chain three times and say what the differences mean."""
    scene = build_scene("swinging-chain", {"duration": 5.0, "stiffness": 1e4})
    report = compare_producers(
        scene.experiment,
        read_requests("demlat:verlet,demlat:rk4"),
        folder,
        scene=scene,
        choices=Choices(tasks=False, twins=True),
    )
    other = report.divergences["demlat:rk4"]
    print(f"two integrators: {other.text}")

    bars = scene.experiment.geometry.bars
    short = replace(bars, rest_length=0.99 * bars.rest_length)
    wrong = replace(scene.experiment, geometry=replace(scene.experiment.geometry, bars=short))
    (faulty,) = run_producers(wrong, read_requests("demlat:verlet"), folder / "wrong")
    (pair,) = compare_files(report.files[report.reference], [faulty.path]).pairs
    fault = judge_difference(pair.times, pair.rms_over_time, scale=scene.scale, twins=report.twins)
    print(f"links a per cent short: {fault.text}")

    page = save_page(report, folder / "comparison.html")
    assert other.verdict == "chaos"
    assert fault.verdict == "differs"
    assert fault.horizon < other.horizon
    assert report.twins.chaotic
    assert page.stat().st_size > 50_000


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as name:
        main(Path(name))
