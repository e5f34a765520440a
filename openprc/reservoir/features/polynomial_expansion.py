"""Products and powers of states, for a linear readout of what is not linear."""
# ruff: noqa: TID253 - it is scikit-learn's expansion

from __future__ import annotations

from sklearn.preprocessing import PolynomialFeatures


class PolynomialExpansion(PolynomialFeatures):
    """All monomials of the states from degree 1 to `degree`, without the constant.

    The constant is left to the readout, which does not penalise it. F states of degree 2 make
    ``F (F + 3) / 2`` columns: reduce them first, by choosing nodes or by PCA, when there are
    many. Columns are named such as ``"node0.z node1.z"`` and ``"node0.z^2"``.

    Parameters
    ----------
    degree : int
    interaction_only : bool
        Only products of different states.
    """

    def __init__(self, degree: int = 2, *, interaction_only: bool = False) -> None:
        super().__init__(degree=degree, interaction_only=interaction_only, include_bias=False)
