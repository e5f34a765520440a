"""A finished picture and where it goes, whatever it shows."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from openprc.errors import MissingDependency
from openprc.schema.atomic import atomic_file

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Plot:
    """A finished figure and where it goes by default."""

    figure: Figure
    default_path: Path

    def save(self, path: str | Path | None = None, *, dpi: int = 150) -> Path:
        """Write the figure in one step, replacing an earlier one, and return its path.

        Parameters
        ----------
        path : path-like, optional
            By default beside the readout. The ending chooses the format.
        """
        target = self.default_path if path is None else Path(path)
        with atomic_file(target, overwrite=True) as temporary:
            self.figure.savefig(temporary, dpi=dpi, format=target.suffix.lstrip(".") or "png")
        return target


def new_figure(size: tuple[float, float]) -> Figure:
    """Return an empty figure of a size in inches, with a canvas of its own.

    The object interface: no window system, no global state.

    Raises
    ------
    MissingDependency
        When matplotlib is not installed.
    """
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingDependency(
            "matplotlib is not installed",
            expected="matplotlib, which draws the plots",
            fix="pip install matplotlib",
        ) from error
    figure = Figure(figsize=size, layout="constrained")
    FigureCanvasAgg(figure)
    return figure
