"""What the input achieves without the body: the numbers a body has to beat."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from openprc.reservoir.features.base import is_constant
from openprc.reservoir.readout.ridge import Ridge, penalty_of
from openprc.reservoir.training.evaluation import Evaluation, evaluate
from openprc.reservoir.training.trainer import Trainer

#: Networks of the comparison: their mean is reported, since one alone is a matter of luck.
NETWORK_SEEDS = 3
# Beyond this the network takes longer than everything else, and its error hardly falls.
_LARGEST_NETWORK = 500
# Fewer training rows than this for each tap, and the register fits noise.
_ROWS_PER_TAP = 10
# A cubic that leaves more than this unexplained does not solve a task.
_EXPLAINS = 0.9
# An error below this is that of rounding and of the penalty.
_PERFECT = 1e-5


def shift_register(u: NDArray[np.float64], n_taps: int) -> NDArray[np.float64]:
    """Return the last `n_taps` inputs as states, (K, n_taps C), the newest first.

    The input before the first symbol is zero, as it is for the targets; the washout covers it.

    Parameters
    ----------
    u : (K,) or (K, C)
    n_taps : int
        Of every column.
    """
    columns = u.reshape(len(u), -1)
    padded = np.concatenate([np.zeros((n_taps - 1, columns.shape[1])), columns])
    windows = np.lib.stride_tricks.sliding_window_view(padded, n_taps, axis=0)[:, :, ::-1]
    return windows.transpose(0, 2, 1).reshape(len(u), -1).copy()


def input_cubic(u: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return u, u^2 and u^3 of the present input, (K, 3 C): no memory at all."""
    columns = u.reshape(len(u), -1)
    return np.hstack([columns, columns**2, columns**3])


def baseline_readout(readout: Any) -> Ridge:
    """Return a ridge like `readout`, or the default one if it is no ridge."""
    if isinstance(readout, Ridge):
        from sklearn.base import clone

        ridge: Ridge = clone(readout)
        return ridge
    penalty = penalty_of(readout)
    return Ridge() if penalty is None else Ridge(penalty)


def evaluate_baseline(
    trainer: Trainer,
    states: NDArray[np.float64],
    target: NDArray[np.float64],
    *,
    usable: NDArray[np.bool_] | None = None,
) -> Evaluation:
    """Fit and score `states` on the very rows that `trainer` uses.

    Parameters
    ----------
    states : (R, F)
    target : (R,) or (R, O)
    usable : (R,) bool, optional
        Rows whose target is defined.
    """
    measured = trainer.states.usable
    return evaluate(
        baseline_readout(trainer.readout),
        states,
        target.reshape(len(states), -1),
        split=trainer.split,
        usable=measured if usable is None else measured & usable,
    )


@dataclass(frozen=True)
class Baselines:
    """What a task costs without the body, on the rows and with the penalty of the body's readout.

    Parameters
    ----------
    shift_register : Evaluation
        A linear readout of the last ``n_taps`` inputs: perfect linear memory of the size of the
        body, and no nonlinearity.
    raw_input : Evaluation
        A linear readout of the present input.
    cubic : Evaluation
        A cubic of the present input.
    networks : tuple of Evaluation
        Echo state networks with as many nodes as the body has states, one per seed.
    n_taps, n_nodes : int
    remarks : tuple of str
    """

    shift_register: Evaluation
    raw_input: Evaluation
    cubic: Evaluation
    networks: tuple[Evaluation, ...]
    n_taps: int
    n_nodes: int
    remarks: tuple[str, ...]

    def figures(
        self, figure: Callable[[Evaluation], float], *, body: float, name: str, error: bool
    ) -> dict[str, float]:
        """Return the baselines as named numbers, and the skill of the body.

        Parameters
        ----------
        figure : callable
            The figure of the task for an evaluation on the test rows.
        body : float
            That of the body.
        name : str
            Of the figure, such as "nrmse".
        error : bool
            Whether less is better; otherwise 1 is best.

        Returns
        -------
        mapping
            ``skill`` is ``1 - e / e0`` of the errors (or shortfalls from 1) of body and shift
            register, and is left out where the register is perfect.
        """
        values = {
            f"baseline_{name}": figure(self.shift_register),
            f"raw_input_{name}": figure(self.raw_input),
            f"cubic_{name}": figure(self.cubic),
        }
        if self.networks:
            values[f"esn_{name}"] = float(np.mean([figure(one) for one in self.networks]))
        for skill, rival in (("skill", "baseline"), ("skill_over_esn", "esn")):
            if f"{rival}_{name}" not in values:
                continue
            rest = values[f"{rival}_{name}"] if error else 1.0 - values[f"{rival}_{name}"]
            if rest > _PERFECT:
                values[skill] = 1.0 - (body if error else 1.0 - body) / rest
        return values

    def metadata(self, readout: Any) -> dict[str, Any]:
        """Return how the numbers were come by."""
        told: dict[str, Any] = {
            "baseline": "linear ridge on the last n_taps inputs and an intercept, as many as the "
            "body has states that change",
            "n_taps": self.n_taps,
            "baseline_regularization": baseline_readout(readout).regularization,
            "skill_definition": "1 - error / error of the shift register",
        }
        if self.networks:
            told["esn"] = "echo state networks with as many nodes, mean over their seeds"
            told["esn_nodes"] = self.n_nodes
            told["esn_seeds"] = len(self.networks)
        return told

    def task_remarks(self, nrmse: float) -> Iterator[str]:
        """Yield what a reader of the body's `nrmse` should know about a task that needs none."""
        yield from self.remarks
        cubic, register = self.cubic.mean_nrmse, self.shift_register.mean_nrmse
        if register <= _PERFECT:
            yield "the shift register solves this task, so it takes memory only: see the capacities"
            return
        if cubic <= min(register, _EXPLAINS) and self.n_taps > 1:
            yield (
                f"a cubic of the present input alone has an NRMSE of {cubic:.3g}, less than the "
                "shift register: on this input the task needs no memory, and the skill shows none"
            )
        elif cubic <= nrmse:
            yield f"a cubic of the present input alone does better: its NRMSE is {cubic:.3g}"


def compute_baselines(
    trainer: Trainer,
    u: NDArray[np.float64],
    target: NDArray[np.float64],
    *,
    usable: NDArray[np.bool_] | None = None,
    n_networks: int = NETWORK_SEEDS,
) -> Baselines:
    """Score shift register, raw input, cubic and echo state networks on a target.

    Parameters
    ----------
    u : (R,) or (R, C)
        The input on the rows of the trainer.
    target : (R,) or (R, O)
    usable : (R,) bool, optional
        Rows whose target is defined.
    n_networks : int
        Seeds of the echo state network; 0 leaves it out.
    """

    def score(candidate: NDArray[np.float64]) -> Evaluation:
        return evaluate_baseline(trainer, candidate, target, usable=usable)

    states = trainer.states
    train, _ = trainer.split.masks(states.usable)
    n_states = max(int(np.count_nonzero(~is_constant(states.values[train]))), 1)
    n_columns = u.reshape(len(u), -1).shape[1]
    remarks = []
    n_taps = max(n_states // n_columns, 1)
    most = max(len(train) // (_ROWS_PER_TAP * n_columns), 1)
    if n_taps > most:
        remarks.append(
            f"the shift register has {most} taps, not {n_taps}, as many as states: more than one "
            f"for {_ROWS_PER_TAP} training rows would fit noise"
        )
        n_taps = most
    n_nodes = n_states
    if n_networks and n_nodes > _LARGEST_NETWORK:
        remarks.append(
            f"the echo state network has {_LARGEST_NETWORK} nodes, not {n_nodes}, as many as states"
        )
        n_nodes = _LARGEST_NETWORK
    return Baselines(
        shift_register=score(shift_register(u, n_taps)),
        raw_input=score(u.reshape(len(u), -1)),
        cubic=score(input_cubic(u)),
        networks=tuple(score(_network_states(n_nodes, u, seed)) for seed in range(n_networks)),
        n_taps=n_taps,
        n_nodes=n_nodes,
        remarks=tuple(remarks),
    )


def _network_states(n_nodes: int, u: NDArray[np.float64], seed: int) -> NDArray[np.float64]:
    return _driven(n_nodes, u.tobytes(), u.shape, seed)


# A suite asks for the same networks task after task.
@lru_cache(maxsize=2 * NETWORK_SEEDS)
def _driven(n_nodes: int, u: bytes, shape: tuple[int, ...], seed: int) -> NDArray[np.float64]:
    from openprc.reservoir.networks.baseline import (  # noqa: PLC0415 - a network only when asked
        reference_network,
    )

    return reference_network(n_nodes, np.frombuffer(u).reshape(shape), seed=seed)


def input_copies(trainer: Trainer, u: NDArray[np.float64]) -> list[str]:
    """Return the names of the states that are the input (R,) up to scale and offset.

    They are those of driven nodes: measured, and legitimate, but computed by nothing.
    """
    states = trainer.states
    rows, _ = trainer.split.masks(states.usable)
    x = states.values[rows] - states.values[rows].mean(axis=0)
    v = u[rows] - u[rows].mean()
    power = np.einsum("ij,ij->j", x, x) * (v @ v)
    # 1 - r^2 of a copy in single precision is about 1e-13; of the best echo, far above 1e-6.
    copies = (x.T @ v) ** 2 >= (1.0 - 1e-6) * power
    copies &= ~is_constant(states.values[rows])
    return [name for name, flag in zip(states.names, copies, strict=True) if flag]


def copy_remark(trainer: Trainer, u: NDArray[np.float64]) -> Iterator[str]:
    """Yield a remark on states that are the input itself."""
    copies = input_copies(trainer, u)
    if copies:
        listed = ", ".join(copies[:3]) + (", ..." if len(copies) > 3 else "")
        yield f"{len(copies)} of {len(trainer.states.names)} states follow the input: {listed}"
