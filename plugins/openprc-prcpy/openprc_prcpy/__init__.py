"""PRCpy experiment folders: one text file for each scan, or for each device."""

from importlib import import_module
from typing import Any

from openprc.hooks import ExtensionSpec, OptionSpec, ProducerSpec, hookimpl

OPENPRC_PLUGIN_API = "1.0"

_LAZY = {
    "PRCpyData": "openprc_prcpy.experiment",
    "read_prcpy": "openprc_prcpy.experiment",
}

__all__ = [
    "OPENPRC_PLUGIN_API",
    "PRCpyData",
    "openprc_extensions",
    "openprc_producers",
    "read_prcpy",
]

_OPTIONS = (
    OptionSpec("prefix", "How the names of the scans begin; found when one prefix stands out."),
    OptionSpec("xs", "Column of the sweep axis, or of time with transpose (PRCpy: Xs)."),
    OptionSpec("readouts", "Column that was measured (PRCpy: Readouts)."),
    OptionSpec(
        "delimiter",
        "What separates the columns: a character, or tab, comma, semicolon, space; found when "
        "left out.",
    ),
    OptionSpec("remove_bg", "Subtract the background file.", kind="bool", default=False),
    OptionSpec("bg_fname", "Name of the background file in the folder."),
    OptionSpec("smooth", "Savitzky-Golay filter along the sweep.", kind="bool", default=False),
    OptionSpec("smooth_win", "Window of the filter, in samples of the sweep.", kind="int"),
    OptionSpec("smooth_rank", "Degree of its polynomial.", kind="int"),
    OptionSpec("cut_xs", "Keep x1 <= xs <= x2 only.", kind="bool", default=False),
    OptionSpec("x1", "Lower end of the cut.", kind="float"),
    OptionSpec("x2", "Upper end of the cut.", kind="float"),
    OptionSpec("normalize_local", "Map every scan to [0, 1].", kind="bool", default=False),
    OptionSpec("normalize_global", "Map all scans to [0, 1].", kind="bool", default=False),
    OptionSpec(
        "sample", "Keep one sample of the sweep in sample_rate.", kind="bool", default=False
    ),
    OptionSpec("sample_rate", "Step of the subsampling.", kind="int"),
    OptionSpec(
        "transpose",
        "Time runs down the rows, and every file is a device.",
        kind="bool",
        default=False,
    ),
    OptionSpec(
        "gaps",
        "What to do when scan numbers are missing: refuse, or close the ranks as PRCpy does.",
        default="error",
        choices=("error", "close"),
    ),
    OptionSpec(
        "input",
        "Whether file names carry the input: where all of them do (auto), always (names), "
        "never (none).",
        default="auto",
        choices=("auto", "names", "none"),
    ),
    OptionSpec("interval", "Seconds from one scan to the next.", kind="float"),
    OptionSpec("unit", "Unit of the readouts, where the header does not say."),
    OptionSpec("time_unit", "Unit of time with transpose, where the header does not say."),
)


@hookimpl
def openprc_producers() -> list[ProducerSpec]:
    """Offer the importer."""
    return [
        ProducerSpec(
            name="prcpy",
            summary="PRCpy experiment folders: one text file for each scan or device",
            load="openprc_prcpy.importer:Importer",
            capabilities=("import",),
            time=("physical", "pseudo"),
            options=_OPTIONS,
            sample="openprc_prcpy.samples:write_sample",
        )
    ]


@hookimpl
def openprc_extensions() -> list[ExtensionSpec]:
    """Offer the check of the plugin's own subtree."""
    return [
        ExtensionSpec(
            name="openprc-prcpy",
            summary="Sweep axis and file names of a PRCpy folder",
            load="openprc_prcpy.extension:check",
        )
    ]


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        return getattr(import_module(_LAZY[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
