"""Generate docs/simulation-h5.md from the table: ``python -m openprc.schema.spec_page``."""

from __future__ import annotations

import sys

from openprc.schema.layout import ATTRIBUTES, DATASETS, SCHEMA_VERSION
from openprc.schema.units import UNITS
from openprc.schema.validate import BY_PLUGINS, OPENING, all_checks

_INTRO = f"""# simulation.h5, schema {SCHEMA_VERSION}

This page is generated from `openprc/schema/layout.py`; edit the table there and run
`python -m openprc.schema.spec_page > docs/simulation-h5.md`.

The words MUST, SHOULD and MAY are used as in RFC 2119. Letters in shapes: T frames, N nodes,
D dimensions (2 or 3), E elements, C columns, K input symbols, k nodes of an element or values of
a quantity; `k?` is an axis that may be absent. Time is always axis 0. Text is UTF-8. Required
objects MUST be present; conditional ones MUST be present when their condition holds; optional ones
MAY be. A reader MUST NOT make up what is absent.

A file is written as `NAME.partial` and gets its final name when it is complete. A finished file
MUST NOT be changed: what is derived from it is a new file that names its parents. A reader accepts
every minor version of the major version that it knows and warns when the minor one is newer.

A process killed while writing leaves a partial file whose first `/committed` rows are whole. One
hole is left: HDF5 does not order the writes to its own index of chunks, and a kill at the moment
when that index is split (first after some 64 chunks of one dataset) can lose the file.
`python benchmarks/crash_trial.py --tries 100 [--growing]` kills writers at random and counts. It
says nothing about a loss of power.
"""


def render() -> str:
    """Return the page."""
    lines = [
        _INTRO,
        "## Attributes",
        "",
        "| owner | name | type | need | meaning |",
        "|---|---|---|---|---|",
    ]
    for rule in ATTRIBUTES:
        need = f"{rule.need}: {rule.when}" if rule.when else rule.need
        choices = f" One of {', '.join(f'`{c}`' for c in rule.choices)}." if rule.choices else ""
        lines.append(
            f"| `{rule.owner}` | `{rule.name}` | {rule.type} | {need} | {rule.meaning}{choices} |"
        )
    lines += [
        "",
        "## Datasets",
        "",
        "| path | shape | type | need | meaning |",
        "|---|---|---|---|---|",
    ]
    for row in DATASETS:
        shape = f"({', '.join(row.shape)})" if row.shape else "scalar"
        need = f"{row.need}: when {row.when}" if row.when else row.need
        lines.append(
            f"| `{row.path}` | {shape} | {', '.join(row.dtypes)} | {need} | {row.meaning} |"
        )
    lines += [
        "",
        "`/extensions/<distribution>/...` belongs to the plugin of that distribution: any data, "
        "attribute `version` required. A plugin writes its own data nowhere else. An array there "
        "with the attribute `time_axis` grows with the trajectory, one row a frame; NaN in it "
        "marks what is missing. The tracker of the package writes `/extensions/openprc-vision`: "
        "`quality` (T, N), `sigma` (T, N, D) in the unit of the positions, `status` (T, N) and "
        "`template` (T, N).",
        "",
        "`/vision/...` is what `openprc.vision.save` keeps beside the trajectory: the video, the "
        "points, the raw tracks, and the signals, in the layout of the older tracker, so that "
        "programs which read that layout read this file too. It is no part of the trajectory: "
        "a reader of the contract MAY pass it over, and nothing in it changes what the "
        "trajectory says.",
        "",
        "## Units",
        "",
        "| unit | measures | factor to SI |",
        "|---|---|---|",
    ]
    lines += [f"| `{u.symbol}` | {u.dimension} | {u.si_factor!r} |" for u in UNITS.values()]
    lines += [
        "",
        "## Checks",
        "",
        "`openprc validate FILE` runs these. Codes are stable. An error refuses the file, a "
        "warning allows it, a hint suggests.",
        "",
        "| code | level | profile | what has to hold |",
        "|---|---|---|---|",
    ]
    lines += [f"| {code} | error | default | {demand} |" for code, demand in OPENING.items()]
    lines += [
        f"| {item.code} | {item.level} | {item.profile} | {item.demand} |"
        for item in all_checks().values()
    ]
    lines += [
        f"| {code} | {level} | default | {demand} |" for code, (level, demand) in BY_PLUGINS.items()
    ]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.stdout.write(render())
