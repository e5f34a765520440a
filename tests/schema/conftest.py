"""Small trajectories that the tests of the file contract share."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from openprc.schema import Provenance, TrajectoryWriter

N_FRAMES, N_NODES, DIMS, DT = 12, 4, 3, 0.1


def complete_frames(start: int = 0, stop: int = N_FRAMES) -> dict[str, Any]:
    """Everything that `declare_complete` declares, in closed form, for frames start to stop."""
    frame = np.arange(start, stop)
    node = np.arange(N_NODES)
    phase = frame[:, None] * 0.5 + node
    positions = np.stack([node + np.sin(phase), np.cos(phase), phase**2 / 50], axis=2)
    velocities = np.stack([np.cos(phase), -np.sin(phase), phase / 25], axis=2) / DT / 2
    observed = np.ones((len(frame), N_NODES), "u1")
    observed[frame == 3, 1] = 0
    observed[frame == 5, 2] = 2
    positions[observed == 0] = np.nan
    velocities[observed == 0] = np.nan
    drive = np.repeat(np.array([0.5, -0.25, 1.0]), 4)[start:stop, None]
    return {
        "time": frame * DT,
        "positions": positions,
        "velocities": velocities,
        "observed": observed,
        "elements": {
            ("bars", "length"): 1.0 + 0.1 * np.sin(phase[:, :3]),
            ("bars", "end_forces"): np.stack([phase[:, :3], -phase[:, :3]], axis=2),
            ("hinges", "angle"): phase[:, :1],
        },
        "channels": {"strain": np.stack([np.sin(frame), np.cos(frame)], axis=1)},
        "system": {"kinetic_energy": np.sin(frame) ** 2},
        "inputs": {"drive": drive},
    }


def declare_complete(writer: TrajectoryWriter) -> None:
    """Declare one of everything."""
    writer.declare_time(unit="s")
    writer.declare_nodes(
        N_NODES, DIMS, unit="m", velocities=True, observed=True,
        rest=np.arange(12.0).reshape(4, 3), mass=[0.1, 0.2, 0.3, 0.4],
        fixed=[True, False, False, False], ids=[10, 20, 30, 40], labels=["a", "b", "c", "d é"],
    )  # fmt: skip
    writer.declare_elements(
        "bars", [[0, 1], [1, 2], [2, 3]],
        series={"length": "m", "end_forces": "N"}, widths={"end_forces": 2},
        static={"stiffness": ([100.0, 200.0, 300.0], "N/m"), "material": (["p", "q", "r"], None),
                "group": ([1, 2, 1], None)},
    )  # fmt: skip
    writer.declare_elements("hinges", [[1, 2, 0, 3]], series={"angle": "rad"})
    writer.declare_channel("strain", ["top", "bottom"], unit="1", quantity="strain")
    writer.declare_system("kinetic_energy")
    writer.declare_input(
        "drive", ["u"], quantity="force", unit="N", targets=["a"],
        sequence=[[0.5], [-0.25], [1.0]], hold=0.4, start=0.0,
    )  # fmt: skip
    writer.declare_extension("openprc-test", "1.2")
    writer.put_extension("openprc-test", "camera", np.eye(3), unit="mm", comment="a matrix")
    writer.put_extension("openprc-test", "words", ["one", "zwei"])


def write_complete(path: Path, *, source: Path | None = None, **options: Any) -> Path:
    """Write the complete trajectory."""
    provenance = Provenance(
        "test", producer_version="3.1", plugin_version="0.1", command="make it", seed=7,
        deterministic=True, config={"b": 2, "a": [1.5, None]},
    )  # fmt: skip
    with TrajectoryWriter(path, provenance=provenance, title="A test", **options) as writer:
        declare_complete(writer)
        if source is not None:
            writer.add_source(source)
        writer.note("one remark")
        frames = complete_frames()
        writer.append(frames.pop("time"), **frames)
    return path


@pytest.fixture
def make_complete() -> Callable[..., Path]:
    """Writer of the complete trajectory."""
    return write_complete


@pytest.fixture
def frames_of() -> Callable[..., dict[str, Any]]:
    """Arrays of the complete trajectory by frame range."""
    return complete_frames


@pytest.fixture
def declare_everything() -> Callable[[TrajectoryWriter], None]:
    """Declarations of the complete trajectory."""
    return declare_complete


@pytest.fixture(scope="session")
def complete_template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A finished file with one of everything, to be copied."""
    folder = tmp_path_factory.mktemp("template")
    source = folder / "source.txt"
    source.write_text("what it was made from")
    return write_complete(folder / "complete.h5", source=source)


@pytest.fixture
def complete(tmp_path: Path, complete_template: Path) -> Path:
    """A finished file with one of everything."""
    return Path(shutil.copyfile(complete_template, tmp_path / "complete.h5"))


@pytest.fixture
def make_small(tmp_path: Path) -> Callable[..., Path]:
    """Writer of a minimal file: two nodes in two dimensions, at the given instants."""

    def make(
        name: str = "small.h5", time: Any = (0.0, 0.1, 0.2), *, scale: float = 1.0,
        clock: dict[str, str] | None = None, **options: Any,
    ) -> Path:  # fmt: skip
        path = tmp_path / name
        with TrajectoryWriter(path, provenance=Provenance("test"), **options) as writer:
            if clock:
                writer.declare_time(**clock)
            writer.declare_nodes(2, 2, unit="m")
            for i, t in enumerate(time):
                writer.append(t, positions=scale * np.array([[i, 0.0], [1.0 + i, 2.0 + i]]))
        return path

    return make


@pytest.fixture
def small(make_small: Callable[..., Path]) -> Path:
    """A minimal finished file of three frames."""
    return make_small()


@pytest.fixture
def edit() -> Callable[[Path], AbstractContextManager[h5py.File]]:
    """Open a finished file for tampering, which nothing in the package does."""

    @contextmanager
    def tamper(path: Path) -> Iterator[h5py.File]:
        with h5py.File(path, "r+") as file:
            yield file

    return tamper


@pytest.fixture
def unfinished(tmp_path: Path) -> Callable[..., Path]:
    """Writer of a partial file: `committed` frames safe, status as a killed run leaves it."""

    def make(name: str = "run.h5", *, committed: int = 8, lost: int = 4) -> Path:
        writer = TrajectoryWriter(tmp_path / name, provenance=Provenance("test"))
        declare_complete(writer)
        frames = complete_frames(0, committed)
        writer.append(frames.pop("time"), **frames)
        writer.commit()
        writer._file.close()  # as a kill does, without close()
        with h5py.File(writer.partial, "r+") as file:
            grown = [
                name
                for name in _dataset_names(file)
                if name.startswith("time_series") or name.endswith("value")
            ]
            for item in grown:
                file[item].resize(committed + lost, axis=0)
        return writer.partial

    return make


def _dataset_names(file: h5py.File) -> list[str]:
    names: list[str] = []
    file.visititems(
        lambda name, item: names.append(name) if isinstance(item, h5py.Dataset) else None
    )
    return names
