"""What a study leaves in its folder besides points and reference."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

from openprc.schema.atomic import atomic_file
from openprc.tradeoff.picture import draw_study

if TYPE_CHECKING:
    from openprc.tradeoff.recommendation import Recommendation
    from openprc.tradeoff.study import Study

RESULT = "tradeoff.json"


def save_study(study: Study, advice: Recommendation | None, folder: Path) -> list[Path]:
    """Write everything as JSON, and the picture; earlier ones are replaced.

    Raises
    ------
    MissingDependency
        When matplotlib is not installed.
    """
    told = study.as_dict() | {"recommendation": None if advice is None else advice.as_dict()}
    path = folder / RESULT
    with atomic_file(path, overwrite=True) as temporary:
        # A number that is none would be read back by few.
        temporary.write_text(json.dumps(told, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    picture = draw_study(study, folder).save()
    written = [path, picture]
    if advice is not None and advice.folder is not None:
        written.append(advice.folder / "input" / "config.json")
    return written
