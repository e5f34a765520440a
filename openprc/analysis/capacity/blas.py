"""How many threads the matrix products may use."""

from __future__ import annotations

from contextlib import AbstractContextManager, nullcontext
from typing import Any

from openprc.errors import TaskError


def blas_limit(threads: int | None) -> AbstractContextManager[Any]:
    """Return a context in which BLAS uses that many threads, or as many as before (None).

    Several processes that each start several threads slow each other down many times over.

    Raises
    ------
    TaskError
        When the number is below 1.
    """
    if threads is None:
        return nullcontext()
    if isinstance(threads, bool) or not isinstance(threads, int) or threads < 1:
        raise TaskError(
            f"blas_threads is {threads!r}",
            expected="a whole number from 1 on, or None to leave it as it is",
            fix="correct it",
            key="blas_threads",
        )
    from threadpoolctl import threadpool_limits  # noqa: PLC0415 - reads all libraries loaded

    return threadpool_limits(threads, user_api="blas")
