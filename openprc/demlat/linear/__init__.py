"""Direct solution of sparse symmetric systems inside compiled time loops.

`analyse` looks at the pattern once, in Python. `factorise`, `solve` and `refine` are compiled,
allocate nothing, and may be called from other compiled functions.
"""

from openprc.demlat.linear.ldl import (
    PIVOT_TOLERANCE,
    clear,
    factorise,
    multiply,
    refine,
    solve,
)
from openprc.demlat.linear.symbolic import Factor, analyse

__all__ = [
    "PIVOT_TOLERANCE",
    "Factor",
    "analyse",
    "clear",
    "factorise",
    "multiply",
    "refine",
    "solve",
]
