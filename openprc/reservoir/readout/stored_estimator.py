"""An estimator that is no table of weights, kept in readout.h5 without pickle: by skops."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from importlib.metadata import version
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.errors import MissingDependency, TaskError, UnsafeFile

#: Where the bytes and the versions they were written by are kept.
ESTIMATOR, VERSIONS = "model/estimator", "estimator_versions"
_STAMPED = ("scikit-learn", "skops", "numpy")


def skops_is_there() -> bool:
    """Say whether skops can be imported, without importing it."""
    return find_spec("skops") is not None


def pack_estimator(estimator: Any) -> NDArray[np.uint8]:
    """Return a fitted estimator as bytes, (n,).

    Raises
    ------
    MissingDependency
        When skops is not installed.
    TaskError
        When skops cannot store it.
    """
    io = _skops("keep the estimator")
    try:
        return np.frombuffer(io.dumps(estimator), dtype=np.uint8)
    except (io.exceptions.UnsupportedTypeException, TypeError, AttributeError) as error:
        raise TaskError(
            f"skops cannot store {type(estimator).__name__}: {error}",
            expected="an estimator made of known types",
            fix="save with estimator=False, which keeps predictions and scores",
            key="readout",
        ) from error


def versions() -> list[str]:
    """Return what a packed estimator depends on, such as ``"numpy 2.4.6"``."""
    return [f"{name} {version(name)}" for name in _STAMPED]


def unpack_estimator(data: NDArray[np.uint8], *, trusted: Sequence[str], file: Path) -> Any:
    """Return the estimator that bytes stand for.

    Parameters
    ----------
    trusted : sequence of str
        Names of types, beyond those of scikit-learn and NumPy, that may be made.

    Raises
    ------
    MissingDependency
        When skops is not installed.
    UnsafeFile
        When the bytes would make a type that is not trusted; nothing has been made then.
    """
    io = _skops("read the estimator in this file", file=file)
    content = data.tobytes()
    doubtful = sorted(set(io.get_untrusted_types(data=content)) - set(trusted))
    if doubtful:
        listed = ", ".join(doubtful)
        raise UnsafeFile(
            f"the estimator is made of types that nobody has vouched for: {listed}",
            expected="types of scikit-learn and NumPy, or types named as trusted",
            fix=f"if you know where the file is from, pass trusted={doubtful!r}",
            file=file,
            key=ESTIMATOR,
        )
    return io.loads(content, trusted=list(trusted))


def version_remarks(stored: Sequence[str]) -> tuple[str, ...]:
    """Return remarks on an estimator that was stored under other versions."""
    differing = [
        f"{was} (now {now})"
        for was, now in zip(stored, versions(), strict=False)
        if _minor(was) != _minor(now)
    ]
    if not differing:
        return ()
    return ("the estimator was stored under " + ", ".join(differing) + "; train again if in doubt",)


def _minor(stamp: str) -> str:
    return ".".join(stamp.split(".")[:2])


def _skops(purpose: str, *, file: Path | None = None) -> Any:
    if not skops_is_there():
        raise MissingDependency(
            f"skops is needed to {purpose}, and is not installed",
            expected="skops 0.11 or later",
            fix="pip install skops",
            file=file,
            key=ESTIMATOR,
        )
    import_module("skops.io.exceptions")
    return import_module("skops.io")
