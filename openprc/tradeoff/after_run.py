"""The downstream side of a study: storage, readouts and estimators on the run of the reference."""

from __future__ import annotations

import tempfile
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from openprc.errors import OpenPRCError
from openprc.hooks.running import silent
from openprc.tradeoff.file_runs import run_to_file
from openprc.tradeoff.point import Point
from openprc.tradeoff.scoring import REFERENCE
from openprc.tradeoff.settings import configured

if TYPE_CHECKING:
    from openprc.hooks.protocols import Progress
    from openprc.scenes.scene import Scene
    from openprc.tradeoff.workbench import Workbench

#: Groups that `openprc.tradeoff.downstream` varies.
DOWNSTREAM = ("storage", "readout", "estimator")


def measure_downstream(
    bench: Workbench, scene: Scene, groups: tuple[str, ...], *, progress: Progress = silent
) -> list[str]:
    """Measure what happens to a run after it; return what could not be done, and why.

    A group that was measured to its end is not measured again.
    """
    todo = tuple(
        group
        for group in DOWNSTREAM
        if group in groups and bench.store.get(REFERENCE, {"finished": group}) is None
    )
    if not todo:
        return []
    if scene.input_name is None:
        # Storage is varied by its error in positions all the same.
        return [f"{', '.join(todo)} by task scores: nothing drives the body at random"]
    # scikit-learn takes seconds to import, and only driven scenes need it.
    from openprc.tradeoff.downstream import downstream_points  # noqa: PLC0415

    experiment = configured(scene.experiment, bench.reference.setting)
    experiment = replace(experiment, stored=replace(experiment.stored, precision="float64"))
    with tempfile.TemporaryDirectory(prefix="openprc-tradeoff-") as folder:
        path = Path(folder) / "simulation.h5"
        bench.check_budget()
        progress(0.0, "the run of the reference")
        try:
            run_to_file(experiment, path)
            for group in todo:
                for point in downstream_points(path, scene, groups=(group,), progress=progress):
                    bench.store.put(point)
                    bench.n_measured += 1
                    bench.check_budget()
                done = Point(group=REFERENCE, label="finished", setting={"finished": group})
                bench.store.put(done)
        except OpenPRCError as problem:
            return [f"{', '.join(todo)} by task scores: {problem.found}"]
    return []
