"""What back ends beside the compiled CPU kernels share: blocks of frames, and blow-ups."""

from __future__ import annotations

from typing import TYPE_CHECKING

from openprc.demlat.models.barhinge.divergence import strained_most, way_out
from openprc.demlat.models.barhinge.support import ESCAPE_FACTOR, scene_size
from openprc.demlat.models.barhinge.tables import FrameBuffer
from openprc.demlat.planning.stability import step_limit
from openprc.errors import Diverged

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from openprc.schema.experiment import Experiment

#: Saved frames are handed on when about this much has gathered, or after that many frames.
BLOCK_BYTES = 16 << 20
BLOCK_FRAMES = 64


def frame_block(experiment: Experiment) -> FrameBuffer:
    """Return a buffer for as many frames of `experiment` as are handed on at once."""
    geometry = experiment.geometry
    frame_bytes = 48 * geometry.n_nodes + 16 * (len(geometry.bars) + len(geometry.hinges))
    most = min(BLOCK_BYTES // frame_bytes, BLOCK_FRAMES)
    return FrameBuffer.for_frames(
        max(1, min(experiment.n_frames, most)),
        n_nodes=geometry.n_nodes,
        dims=3,
        n_bars=len(geometry.bars),
        n_hinges=len(geometry.hinges),
    )


def head(out: FrameBuffer, count: int) -> FrameBuffer:
    """Return the first `count` frames of a buffer."""
    return type(out)(*(column[:count] for column in out))


def plausible_size(experiment: Experiment) -> float:
    """Return the size [m] beyond which a coordinate is no result but a blow-up."""
    return ESCAPE_FACTOR * scene_size(experiment)


def diverged(
    experiment: Experiment, positions: NDArray[np.float64], *, node: int, axis: int, time: float
) -> Diverged:
    """Return the error of a run in which a coordinate left the plausible range.

    Parameters
    ----------
    experiment : Experiment
    positions : (N, 3) [m]
        When the run was stopped.
    node, axis : int
        Of the coordinate.
    time : float [s]
        By which it had done so.
    """
    return Diverged(
        f"node {node} left the range of plausible positions along {'xyz'[axis]}"
        f" by t = {time:.6g} s{strained_most(experiment, positions, node)}",
        expected=f"coordinates below {plausible_size(experiment):.3g} m",
        fix=f"{way_out(step_limit(experiment), experiment.dt)}; frames up to then are in the"
        " partial file",
        key="simulation.dt",
    )
