"""A PyBullet server of our own, without a window and without its chatter on stdout."""

from __future__ import annotations

import ctypes
import os
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from types import ModuleType
from typing import Any

from openprc.errors import MissingDependency
from openprc_pybullet import INSTALL


def load_pybullet(reason: str) -> ModuleType:
    """Import PyBullet.

    Raises
    ------
    MissingDependency
        When it is not installed, or was built for another NumPy; names what `reason` needs.
    """
    try:
        with quiet(), silent_errors():  # on import it prints when it was built, to stderr
            return import_module("pybullet")
    except ImportError as error:
        raise MissingDependency(
            f"{reason} needs PyBullet, which cannot be imported: {error}",
            expected="pybullet 3.2.7 or later",
            fix=INSTALL,
        ) from error


@contextmanager
def direct_client(reason: str) -> Iterator[tuple[ModuleType, int]]:
    """Yield the module and the id of a fresh in-process server, closed afterwards.

    Every call has to name ``physicsClientId``: the user may have servers of their own.
    """
    pybullet = load_pybullet(reason)
    with quiet():
        client = pybullet.connect(pybullet.DIRECT)
    if client < 0:
        raise MissingDependency(
            f"{reason}: PyBullet refused to start another server",
            expected="fewer than 1024 servers in this process",
            fix="disconnect the ones that are no longer used",
        )
    try:
        yield pybullet, client
    finally:
        with quiet():
            pybullet.disconnect(physicsClientId=client)


@contextmanager
def quiet() -> Iterator[None]:
    """Send what C code writes to file descriptor 1 to descriptor 2 meanwhile.

    Bullet prints remarks with printf. On stdout they would end up inside the JSON that a
    command prints, and `contextlib.redirect_stdout` does not reach C.
    """
    flush = _c_flush()
    try:
        saved = os.dup(1)
    except OSError:  # no stdout at all, as under a service manager: nothing to protect
        yield
        return
    flush(None)
    try:
        os.dup2(2, 1)
        yield
    finally:
        flush(None)
        os.dup2(saved, 1)
        os.close(saved)


@contextmanager
def silent_errors() -> Iterator[None]:
    """Drop what is written to file descriptor 2 meanwhile."""
    flush = _c_flush()
    try:
        saved = os.dup(2)
    except OSError:
        yield
        return
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        flush(None)
        os.dup2(saved, 2)
        os.close(saved)
        os.close(nowhere)


def _c_flush() -> Any:
    if os.name == "nt":  # ctypes finds no C library under the name None there
        return lambda _: None
    return ctypes.CDLL(None).fflush
