"""What a refinement is asked for, and what it answers."""

from __future__ import annotations

from dataclasses import dataclass, fields
from enum import IntEnum
from typing import Any, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from openprc.errors import ConfigError

__all__ = ["Reason", "RefineSettings", "Refined"]

Model = Literal["auto", "quadratic", "affine", "translation"]


class Reason(IntEnum):
    """Why a refinement was not accepted."""

    ACCEPTED = 0
    NO_TEMPLATE = 1
    """The template's number is negative or was never given out, or the guess is not finite."""
    LEFT_IMAGE = 2
    """The window reaches beyond the outermost pixels."""
    NOT_CONVERGED = 3
    """Still moving after the last iteration, or too far from the guess."""
    BELOW_GATE = 4
    """The best match is too different or too uncertain, or the image has no texture or no values
    there."""
    SINGULAR = 5
    """The window was folded or blown up."""


@dataclass(frozen=True, kw_only=True)
class RefineSettings:
    """How templates are matched to images.

    Parameters
    ----------
    subset : int [px]
        Side of the square window, odd.
    model : {"auto", "quadratic", "affine", "translation"}
        What a window may do from the template to the image. "auto" is affine, quadratic where
        the match shows curvature, and draws deformation and curvature towards none as far as
        noise explains them; there is no jump from one model to another.
    max_iterations : int
        Refinements that need more are refused; "auto" may begin anew with a simpler or a richer
        model, and each has as many.
    tolerance : float [px]
        Remaining error of the iteration at which it ends.
    max_znssd : float
        Zero-mean normalised sum of squared differences, 2 (1 - ZNCC), up to which a match is
        accepted; where noise explains more than that, three times what it explains.
    max_sigma : float [px]
        One-sigma of either coordinate up to which a match is accepted: at 0.25 px, normal errors
        of more than 1 px are 3 in 10 000.
    max_shift : float [px]
        How far from its guess a point may end up.
    """

    subset: int = 21
    model: Model = "auto"
    max_iterations: int = 20
    tolerance: float = 1e-3
    max_znssd: float = 0.1
    max_sigma: float = 0.25
    max_shift: float = 8.0

    def __post_init__(self) -> None:
        self._check("subset", isinstance(self.subset, int), "a whole number of pixels")
        self._check("subset", 5 <= self.subset <= 101 and self.subset % 2 == 1, "odd, 5 to 101")
        self._check("model", self.model in get_args(Model), "one of " + ", ".join(get_args(Model)))
        self._check("max_iterations", self.max_iterations >= 1, "at least 1")
        self._check("tolerance", 0.0 < self.tolerance < 1.0, "between 0 and 1 px")
        self._check("max_znssd", 0.0 < self.max_znssd < 2.0, "between 0 and 2")
        self._check("max_sigma", self.max_sigma > 0.0, "a positive number of pixels")
        self._check("max_shift", 0.0 < self.max_shift < np.inf, "a positive number of pixels")

    def _check(self, key: str, good: bool, expected: str) -> None:
        if not good:
            raise ConfigError(
                f"{getattr(self, key)!r}",
                expected=expected,
                fix="give such a value, or leave the setting out",
                key=f"refinement.{key}",
            )

    def as_dict(self) -> dict[str, Any]:
        """Return the settings as plain values, for provenance."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


@dataclass(frozen=True, kw_only=True)
class Refined:
    """Where templates were found in an image; values of refused ones are the last tried.

    Parameters
    ----------
    warps : (n, 6)
        px, py [px], a, b, c, d: the point of the template at (dx, dy) from its tracked point
        is at (px + (1 + a) dx + b dy, py + c dx + (1 + d) dy).
    zncc : (n,)
        Zero-mean normalised cross-correlation, NaN where none was computed.
    sigma : (n, 2) [px]
        One standard deviation of the position, from noise and gradient.
    accepted : (n,)
    reason : (n,)
        Values of `Reason`.
    iterations : (n,)
    """

    warps: NDArray[np.float64]
    zncc: NDArray[np.float64]
    sigma: NDArray[np.float64]
    accepted: NDArray[np.bool_]
    reason: NDArray[np.uint8]
    iterations: NDArray[np.int32]

    @property
    def positions(self) -> NDArray[np.float64]:
        """Where the tracked points are: (n, 2) [px]."""
        return self.warps[:, :2]

    @property
    def znssd(self) -> NDArray[np.float64]:
        """Zero-mean normalised sum of squared differences, 2 (1 - ZNCC): (n,)."""
        return 2.0 * (1.0 - self.zncc)
