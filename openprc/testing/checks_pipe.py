"""PIPE: from the producer's file to a readout that remembers."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from openprc.errors import MissingInputError
from openprc.schema.derive import attach_input
from openprc.schema.trajectory import Trajectory
from openprc.testing.cases import ImporterCase, RunnerCase
from openprc.testing.check import check
from openprc.testing.outcome import NotApplicable, fail
from openprc.testing.simulations import driven_lattice, refusal, run
from openprc.testing.workbench import imported, sample_of

#: Symbols back, and the least coefficient of determination on the test rows.
DELAY, ENOUGH = 1, 0.5


def _recall(path: Path) -> float:
    """Return R2 of the input `DELAY` symbols ago, by ridge regression on the states."""
    # scikit-learn takes seconds to import; the other checks need not wait for it.
    from openprc.analysis.benchmarks.choices import Choices  # noqa: PLC0415
    from openprc.analysis.benchmarks.report import score_file  # noqa: PLC0415
    from openprc.analysis.tasks.recall import DelayRecallTask  # noqa: PLC0415

    # A point that was lost for some frames is no reason to recall nothing.
    choices = Choices(missing="interpolate")
    return 1.0 - score_file(path, choices, task=DelayRecallTask(DELAY), n_networks=0).nmse


def _judge(path: Path) -> None:
    with Trajectory(path) as run_:
        if run_.time_kind == "pseudo":
            raise NotApplicable("load steps have no memory to recall from")
        if not run_.inputs:
            raise NotApplicable("nothing says what drove the body of the sample")
    found = _recall(path)
    if not found > ENOUGH:
        fail(
            f"a ridge readout recalls the input {DELAY} symbol ago with R2 = {found:.3g}",
            expected=f"above {ENOUGH:g}",
            fix="look whether input and states have one clock, and "
            "whether the body of the sample has memory",
        )


@check("PIPE-1", "a ridge readout on the imported sample recalls the input before the present one",
       "importer")  # fmt: skip
def imported_body_remembers(case: ImporterCase, folder: Path) -> None:
    """Import, attach what the format has no room for, load the states, train, recall."""
    path = imported(case)
    with Trajectory(path) as run_:
        there, pseudo = run_.inputs, run_.time_kind == "pseudo"
    if not pseudo:
        for name, given in sample_of(case).inputs.items():
            if name not in there:
                driven = folder / f"driven-{name}.h5"
                attach_input(path, driven, name=name, **_signal(given))
                path = driven
    try:
        _judge(path)
    except MissingInputError as error:
        raise NotApplicable(error.found) from error


def _signal(given: Mapping[str, Any]) -> dict[str, Any]:
    return {
        "signal": given["sequence"],
        "hold": given["hold"],
        "start": given.get("start", 0.0),
        "unit": given.get("unit", "1"),
        "quantity": given.get("quantity", "force"),
    }


@check("PIPE-2", "a ridge readout on a driven body recalls the input before the present one",
       "runner")  # fmt: skip
def simulated_body_remembers(case: RunnerCase, folder: Path) -> None:
    """Run the kit's driven lattice, or the case's own scene, load the states, train, recall."""
    scene = driven_lattice(factor=case.dt_factor)
    reason = refusal(case, scene)
    if reason:
        if case.scene is None:
            raise NotApplicable(f"not modelled: {reason}")
        scene = case.scene()
    if case.record.time == ("pseudo",):
        raise NotApplicable("load steps have no memory to recall from")
    _judge(run(case, scene, folder / "out.h5"))


__all__ = ["DELAY", "ENOUGH"]
