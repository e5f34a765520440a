"""What the channels of a body have to do with its input, and with each other.

::

    from openprc.analysis import correlation as corr

    corr.Linear(u, X, lag_sweep=True).ccf.plot(kind="lag_profile").save()
    corr.Nonparametric(u, X).dcor.significant()
    corr.Redundancy(X).groups_named(threshold=0.85)

Metrics are computed when they are first read, and kept. p-values allow for the fact that
successive rows of a recording resemble each other. Nothing heavy is imported until a name is used.
"""

from __future__ import annotations

from importlib import import_module
from typing import Any

_LAZY = {
    "CCAResult": "openprc.analysis.correlation.canonical",
    "Linear": "openprc.analysis.correlation.linear",
    "Nonparametric": "openprc.analysis.correlation.nonparametric",
    "Redundancy": "openprc.analysis.correlation.redundancy",
    "Result": "openprc.analysis.correlation.result",
}

__all__ = ["CCAResult", "Linear", "Nonparametric", "Redundancy", "Result"]


def __getattr__(name: str) -> Any:
    if name in _LAZY:
        return getattr(import_module(_LAZY[name]), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
