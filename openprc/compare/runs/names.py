"""What the runs of a comparison are called, and which of them is the reference."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

from openprc.errors import ConfigError


def files_by_name(paths: Sequence[Path]) -> dict[str, Path]:
    """Return files by the shortest ends of their paths that tell them apart.

    Raises
    ------
    ConfigError
        When there are fewer than two, or one is named twice.
    """
    if len(paths) < 2:
        raise ConfigError(
            f"{len(paths)} file to compare",
            expected="two or more",
            fix="name another one, or run a scene: --scene NAME --producers A,B",
        )
    resolved = [path.resolve() for path in paths]
    for path in paths:
        if resolved.count(path.resolve()) > 1:
            raise ConfigError(
                "the same file is named twice",
                expected="different files",
                fix="leave one out",
                file=path,
            )
    depth = 1
    while len({path.parts[-depth:] for path in resolved}) < len(paths):
        depth += 1
    return {
        str(Path(*path.parts[-depth:])): given for path, given in zip(resolved, paths, strict=True)
    }


def reference_first(files: Mapping[str, Path], wanted: str | None) -> dict[str, Path]:
    """Return the files, the one that is called `wanted` first.

    Raises
    ------
    ConfigError
        When there is none of that name, or several.
    """
    if wanted is None:
        return dict(files)
    found = [name for name, path in files.items() if wanted in (name, str(path), path.name)]
    if len(found) != 1:
        raise ConfigError(
            f"{'several runs are' if found else 'there is no run'} called {wanted!r}",
            expected="one of " + ", ".join(files),
            fix="name one of them",
            key="--reference",
        )
    return {found[0]: files[found[0]], **files}


__all__ = ["files_by_name", "reference_first"]
