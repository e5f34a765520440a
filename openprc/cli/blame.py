"""Whose fault is it: the file's or the program's?"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from openprc.errors import SchemaError
from openprc.schema.validate import validate_file


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Say that the file breaks the contract when that is why reading it failed.

    Readers take the contract for granted, so a file that breaks it may fail in any of these
    ways. The validator decides; what it has nothing to say about is a fault of the program.

    Raises
    ------
    SchemaError
        Naming the first error of the file.
    """
    try:
        yield
    except (ArithmeticError, AttributeError, LookupError, TypeError, ValueError) as error:
        if not path.is_file():
            raise
        errors = validate_file(path).at_least("error")
        if not errors:
            raise
        raise SchemaError(
            f"{errors[0].code}: {errors[0].found}",
            expected=errors[0].expected,
            fix="see everything with `openprc validate`; " + errors[0].fix,
            file=path,
            key=errors[0].path,
        ) from error
