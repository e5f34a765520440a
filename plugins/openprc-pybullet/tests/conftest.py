"""Shared helpers: the folder of recorded data, an import in one call, synthetic logs."""

from __future__ import annotations

import hashlib
import struct
from pathlib import Path

import pytest
from openprc_pybullet import OPTIONS
from openprc_pybullet.client import quiet
from openprc_pybullet.importer import Importer
from openprc_pybullet.runner import Runner

from openprc.hooks.running import refuse_unsupported, silent
from openprc.schema import Provenance, Trajectory, TrajectoryWriter

DATA = Path(__file__).resolve().parents[3] / "../shared/data/pybullet"

ROBOT = (
    "stepCount,timeStamp,objectId,posX,posY,posZ,oriX,oriY,oriZ,oriW,velX,velY,velZ,"
    "omegaX,omegaY,omegaZ,qNum"
)
ROBOT_LETTERS = "IfifffffffffffffI"


class Imported(Trajectory):
    """A trajectory that remembers the notes of its import."""

    notes: tuple[str, ...] = ()


@pytest.fixture
def data():
    """Folder of real recordings."""
    if not DATA.exists():
        pytest.skip("recorded PyBullet files are not beside this checkout")
    return DATA


@pytest.fixture
def pb_import(tmp_path):
    """Import a file; check that the source stays as it is and failure leaves nothing."""
    opened = []

    def run(path, **options):
        out = tmp_path / f"run{len(list(tmp_path.glob('run*.h5')))}.h5"
        values = {option.name: option.default for option in OPTIONS} | {"trust": False} | options
        before = hashlib.sha256(path.read_bytes()).digest()
        try:
            with TrajectoryWriter(
                out, provenance=Provenance("pybullet"), on_failure="discard"
            ) as writer:
                Importer().import_run(path, writer, options=values)
        except BaseException:
            assert not list(tmp_path.glob(f"{out.name}*"))
            raise
        finally:
            assert hashlib.sha256(path.read_bytes()).digest() == before
        result = Imported(out)
        result.notes = writer.notes
        opened.append(result)
        return result

    yield run
    for trajectory in opened:
        trajectory.close()


@pytest.fixture
def pb_run(tmp_path):
    """Run an experiment, by PyBullet unless told otherwise; the result has the run's notes."""
    opened = []

    def run(experiment, *, runner=None, **options):
        out = tmp_path / f"made{len(opened)}.h5"
        runner = runner or Runner()
        refuse_unsupported(runner.supports(experiment), producer="pybullet")
        given = {"options": options} if options else {}
        with TrajectoryWriter(out, provenance=Provenance("pybullet")) as writer:
            runner.run(experiment, writer, seed=None, progress=silent, **given)
        result = Imported(out)
        result.notes = writer.notes
        opened.append(result)
        return result

    yield run
    for trajectory in opened:
        trajectory.close()


@pytest.fixture
def world():
    """PyBullet and a function that starts servers without damping of their own; all are closed."""
    bullet = pytest.importorskip("pybullet", reason="recording needs PyBullet")
    clients = []

    def start(*, gravity=-9.81, dt=1 / 240):
        with quiet():
            clients.append(bullet.connect(bullet.DIRECT))
        bullet.setGravity(0, 0, gravity, physicsClientId=clients[-1])
        bullet.setTimeStep(dt, physicsClientId=clients[-1])
        return clients[-1]

    yield bullet, start
    for client in clients:
        if bullet.getConnectionInfo(client)["isConnected"]:
            with quiet():
                bullet.disconnect(physicsClientId=client)


@pytest.fixture
def recorded(tmp_path):
    """Open what a recording left, finished or not; closed after the test."""
    opened = []

    def look(path=None, **options):
        opened.append(Trajectory(path or tmp_path / "run.h5", **options))
        return opened[-1]

    yield look
    for trajectory in opened:
        trajectory.close()


def _robot_record(step, *, dt=0.01, body=0, pos=(0.0, 0.0, 0.0), vel=(0.0, 0.0, 0.0), q=(), u=(),
                  dof=0):  # fmt: skip
    pad = [0.0] * (dof - len(q))
    return b"\xaa\xbb" + struct.pack(
        f"<{ROBOT_LETTERS}{2 * dof}f",
        step, step * dt, body, *pos, 0, 0, 0, 1, *vel, 0, 0, 0, len(q), *q, *pad, *u, *pad,
    )  # fmt: skip


def _robot_header(dof=0):
    names = [ROBOT, *(f"q{i}" for i in range(dof)), *(f"u{i}" for i in range(dof))]
    return f"{','.join(names)}\n{ROBOT_LETTERS}{'f' * (2 * dof)}\n".encode()


@pytest.fixture
def robot_record():
    """Bytes of one GENERIC_ROBOT record."""
    return _robot_record


@pytest.fixture
def robot_header():
    """Bytes of the two header lines for `dof` joint columns."""
    return _robot_header


@pytest.fixture
def write_log(tmp_path):
    """Write bytes to a file and return its path."""

    def write(*parts, name="synthetic.log"):
        path = tmp_path / name
        path.write_bytes(b"".join(parts))
        return path

    return write
