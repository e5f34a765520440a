"""Seeing what code does to the disk and the terminal while it runs."""

from __future__ import annotations

import contextlib
import hashlib
import io
import os
import sys
import warnings
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

_CHANGES = {
    "os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.link", "os.symlink", "os.truncate",
    "shutil.copyfile", "shutil.move", "shutil.rmtree",
}  # fmt: skip
#: Ends of names that the interpreter and compilers write on their own account.
_OWN = (".pyc", ".nbi", ".nbc")


@dataclass
class Watched:
    """What was seen: files opened for reading and writing, text printed, warnings given."""

    read: list[Path] = field(default_factory=list)
    written: list[Path] = field(default_factory=list)
    printed: str = ""
    warned: list[str] = field(default_factory=list)

    def written_outside(self, *folders: Path) -> list[Path]:
        """Return what was written or changed below none of these folders."""
        homes = [folder.resolve() for folder in folders]
        return [
            path
            for path in dict.fromkeys(self.written)
            if not any(path.is_relative_to(home) for home in homes)
        ]


#: The watchers at work; an audit hook cannot be taken away again.
_ACTIVE: list[Watched] = []
_INSTALLED: list[bool] = []


def _look(event: str, args: tuple[Any, ...]) -> None:
    if not _ACTIVE or (event != "open" and event not in _CHANGES):
        return
    name = args[0]
    if not isinstance(name, str | bytes | os.PathLike):
        return  # a file descriptor: it was opened by name before
    path = Path(os.fsdecode(name))
    if path.name.endswith(_OWN) or "__pycache__" in path.parts or str(path) == os.devnull:
        return
    # Not Path.absolute(): that would look at the current folder, and this is called for it too.
    path = Path(os.path.normpath(Path(os.getcwd()) / path))  # noqa: PTH109
    changes = event != "open" or _writes(args)
    for watched in _ACTIVE:
        (watched.written if changes else watched.read).append(path)


def _writes(args: tuple[Any, ...]) -> bool:
    mode = args[1] if len(args) > 1 else None
    if isinstance(mode, str):
        return any(letter in mode for letter in "wax+")
    flags = args[2] if len(args) > 2 and isinstance(args[2], int) else 0
    return bool(flags & (os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND))


@contextlib.contextmanager
def watching() -> Iterator[Watched]:
    """Watch everything that Python opens or changes, prints and warns about.

    Libraries in C that open files themselves (HDF5) are not seen; snapshots of folders are
    for them.
    """
    if not _INSTALLED:
        sys.addaudithook(_look)
        _INSTALLED.append(True)
    watched = Watched()
    text = io.StringIO()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        _ACTIVE.append(watched)
        try:
            with contextlib.redirect_stdout(text), contextlib.redirect_stderr(text):
                yield watched
        finally:
            # By identity: two watchers that have seen the same are equal.
            _ACTIVE[:] = [item for item in _ACTIVE if item is not watched]
            watched.printed = text.getvalue()
            watched.warned = [f"{w.category.__name__}: {w.message}" for w in caught]


Snapshot = dict[str, str]


def snapshot(folder: Path) -> Snapshot:
    """Return names and digests of everything below a folder."""
    found: Snapshot = {}
    for path in sorted(folder.rglob("*")):
        name = path.relative_to(folder).as_posix()
        if path.is_symlink():
            found[name] = f"link to {path.readlink()}"
        elif path.is_file():
            found[name] = hashlib.sha256(path.read_bytes()).hexdigest()
        else:
            found[name] = "folder"
    return found


def changes(before: Snapshot, after: Snapshot) -> list[str]:
    """Return what differs between two snapshots, in words."""
    gone = [f"{name} is gone" for name in before if name not in after]
    new = [f"{name} is new" for name in after if name not in before]
    other = [f"{name} differs" for name in before if name in after and before[name] != after[name]]
    return gone + new + other


@contextlib.contextmanager
def elsewhere(folder: Path) -> Iterator[Path]:
    """Make `folder` current, home and the place of temporary files, and empty before that."""
    places = {name: folder / name for name in ("current", "home", "temporary")}
    for place in places.values():
        place.mkdir(parents=True, exist_ok=True)
    names = {"HOME": "home", "USERPROFILE": "home", "TMPDIR": "temporary", "TEMP": "temporary",
             "TMP": "temporary", "XDG_CACHE_HOME": "home", "XDG_CONFIG_HOME": "home"}  # fmt: skip
    before = {name: os.environ.get(name) for name in names}
    import tempfile  # noqa: PLC0415 - its cached folder is what is changed here

    kept, here = tempfile.tempdir, Path.cwd()
    try:
        os.environ.update({name: str(places[place]) for name, place in names.items()})
        tempfile.tempdir = str(places["temporary"])
        os.chdir(places["current"])
        yield folder
    finally:
        os.chdir(here)
        tempfile.tempdir = kept
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


__all__ = ["Watched", "changes", "elsewhere", "snapshot", "watching"]
