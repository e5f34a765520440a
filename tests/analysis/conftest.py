"""A file with a drive of known symbols and a small nonlinear body that remembers them."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.reservoir.features.node_features import NodePositions
from openprc.reservoir.io.state_loader import StateLoader
from openprc.reservoir.readout.ridge import Ridge
from openprc.reservoir.training.split import Split
from openprc.reservoir.training.trainer import Trainer
from openprc.schema import Provenance, TrajectoryWriter

HOLD_FRAMES = 4
DT = 0.01
N_SYMBOLS = 600


def echo_network(symbols, n_states, *, seed=3):
    """Return (K, n_states) states of a random tanh network driven by symbols in [-1, 1]."""
    rng = np.random.default_rng(seed)
    recurrent = rng.normal(size=(n_states, n_states))
    recurrent *= 0.8 / np.abs(np.linalg.eigvals(recurrent)).max()
    into, bias = rng.uniform(-0.5, 0.5, n_states), rng.uniform(-0.5, 0.5, n_states)
    states = np.zeros((len(symbols), n_states))
    x = np.zeros(n_states)
    for k, u in enumerate(symbols):
        x = np.tanh(recurrent @ x + into * u + bias)
        states[k] = x
    return states


@pytest.fixture(scope="session")
def symbols():
    """Return the 600 symbols, uniform in [-1, 1]."""
    return np.random.default_rng(21).uniform(-1.0, 1.0, N_SYMBOLS)


@pytest.fixture(scope="session")
def echo_run(tmp_path_factory, symbols):
    """Return the path of a file whose 20 channels are the states of the network."""
    path = tmp_path_factory.mktemp("echo") / "simulation.h5"
    states = np.repeat(echo_network(symbols, 20), HOLD_FRAMES, axis=0)
    with TrajectoryWriter(path, provenance=Provenance("test")) as writer:
        writer.declare_channel("state", [f"s{k}" for k in range(20)], unit="1")
        writer.declare_input(
            "drive", ["u"], quantity="voltage", unit="V", sequence=symbols[:, None],
            hold=HOLD_FRAMES * DT,
        )  # fmt: skip
        writer.append(
            np.arange(len(states)) * DT,
            channels={"state": states},
            inputs={"drive": np.repeat(symbols, HOLD_FRAMES)[:, None]},
        )
    return path


@pytest.fixture
def make_run(tmp_path, symbols):
    """Return a function that writes a run and returns its path.

    Node 0 stands still; nodes 1 to 20 move in z with one state of the network each.
    """

    def make(
        *,
        nodes=True,
        moving=True,
        channels=False,
        inputs=True,
        sequence=True,
        interpolated=False,
        constant_input=False,
        time_kind="physical",
        n_symbols=N_SYMBOLS,
        drive=None,
        name="simulation.h5",
    ):
        used = (symbols if drive is None else np.asarray(drive))[:n_symbols]
        n_frames = len(used) * HOLD_FRAMES
        states = np.repeat(echo_network(used, 20), HOLD_FRAMES, axis=0)
        held = np.repeat(used, HOLD_FRAMES)
        if interpolated:
            held = np.interp(np.arange(n_frames) / HOLD_FRAMES, np.arange(len(used)), used)
        value = np.stack([np.zeros(n_frames), held if not constant_input else 0 * held], axis=1)
        positions = np.zeros((n_frames, 21, 3))
        positions[:, :, 0] = np.arange(21)
        positions[:, 1:, 2] = 1e-3 * states if moving else 0.0
        path = tmp_path / "output" / name
        with TrajectoryWriter(path, provenance=Provenance("test"), overwrite=True) as writer:
            writer.declare_time(unit="s" if time_kind == "physical" else "1", kind=time_kind)
            if nodes:
                writer.declare_nodes(21, 3, unit="m")
            if channels:
                writer.declare_channel("gauge", [f"g{k}" for k in range(20)], unit="V")
            if inputs:
                extra = (
                    {
                        "sequence": np.stack([0 * used, used], axis=1),
                        "hold": HOLD_FRAMES * DT,
                    }
                    if sequence
                    else {}
                )
                writer.declare_input(
                    "base", ["x", "z"], quantity="position", unit="m", targets=["0"], **extra
                )
            writer.append(
                np.arange(n_frames) * DT,
                positions=positions if nodes else None,
                channels={"gauge": states} if channels else None,
                inputs={"base": value} if inputs else None,
            )
        return path

    return make


@pytest.fixture
def loaded(make_run):
    """Return a function that gives a trainer on a run and its input per frame, unscaled."""
    opened = []

    def make(*, readout=None, split=None, **keywords):
        loader = StateLoader(make_run(**keywords))
        opened.append(loader)
        trainer = Trainer(
            NodePositions(dims=[2]),
            readout or Ridge(1e-6),
            loader=loader,
            split=split or Split(washout=2.0, train=14.0, test=8.0),
        )
        return trainer, loader.get_actuation_signal(actuator_idx=0, dof=2)

    yield make
    for loader in opened:
        loader.close()
