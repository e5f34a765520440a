"""``python -m openprc_merlin WORKSPACE --out EXP``: an experiment folder from a workspace."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from openprc.errors import OpenPRCError
from openprc.schema.experiment import save_experiment
from openprc_merlin.workspace_experiment import workspace_experiment


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the folder; return the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m openprc_merlin",
        description="Write a MERLIN workspace as an experiment folder for openprc run.",
    )
    parser.add_argument("workspace", type=Path, help="workspace of a run (.mat, .h5)")
    parser.add_argument("--out", type=Path, required=True, help="experiment folder to make")
    parser.add_argument("--unit", default="m", help="what lengths are in (default: m)")
    parser.add_argument("--force-unit", default="N", help="what forces are in (default: N)")
    parser.add_argument("--c0", type=float, help="modulus of the bars, where the file lacks it")
    parser.add_argument("--mass", type=float, help="of the whole body [kg]")
    parser.add_argument("--increments", type=int, help="as many as the workspace has by default")
    given = parser.parse_args(arguments)
    try:
        if (given.out / "input").exists():
            parser.error(f"{given.out} holds an experiment already; choose another folder")
        experiment = workspace_experiment(
            given.workspace,
            unit=given.unit,
            force_unit=given.force_unit,
            c0=given.c0,
            mass=given.mass,
            increments=given.increments,
        )
        save_experiment(experiment, given.out)
    except OpenPRCError as error:
        sys.stderr.write(f"{error}\n")
        return error.exit_code
    for note in experiment.notes:
        sys.stdout.write(f"note: {note}\n")
    sys.stdout.write(f"openprc run {given.out} --producer merlin\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
