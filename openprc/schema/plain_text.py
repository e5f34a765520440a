"""Text that can be stored as UTF-8 and read back as it was."""

from __future__ import annotations

from pathlib import Path

from openprc.errors import SchemaError


def storable(text: object, *, key: str, file: str | Path | None = None) -> str:
    """Return `text` as a string that HDF5 can hold.

    Raises
    ------
    SchemaError
        When it holds a NUL, which ends text in HDF5, or half of a surrogate pair, which has no
        UTF-8.
    """
    found = str(text)
    try:
        found.encode()
    except UnicodeEncodeError:
        problem = "a character that UTF-8 does not have"
    else:
        if "\0" not in found:
            return found
        problem = "a NUL character"
    raise SchemaError(
        f"{problem} in {found!r}",
        expected="text that can be stored as UTF-8",
        fix="remove the character",
        file=file,
        key=key,
    )
