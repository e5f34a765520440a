"""The runner as a producer: settings, notes, refusals, what is left of a run that ends early."""

import json
import warnings
from dataclasses import replace

import h5py
import numpy as np
import pytest
from openprc_pybullet import RUN_OPTIONS, client
from openprc_pybullet.neutral_world import NeutralWorld
from openprc_pybullet.producer import Producer
from openprc_pybullet.runner import Runner

from openprc.cli.main import main
from openprc.errors import Diverged, MissingDependency, UnsupportedScene
from openprc.hooks.running import simulate
from openprc.schema import Experiment, Provenance, Trajectory
from openprc.schema.digest import content_digest
from openprc.schema.experiment import Actuator, Collision, Signal, save_experiment
from openprc.schema.geometry import Bars, Geometry, Hinges

pybullet = pytest.importorskip("pybullet")


def open_clients():
    """Ids of PyBullet servers that are connected."""
    return [i for i in range(16) if pybullet.getConnectionInfo(i)["isConnected"]]


@pytest.fixture(autouse=True)
def _no_client_stays_open():
    before = open_clients()
    yield
    assert open_clients() == before


def spring(**settings):
    """A mass of 2 kg on a spring of 200 N/m, pushed along x; its limit of stability is 0.2 s."""
    bars = Bars(indices=[[0, 1]], stiffness=[200.0], rest_length=[1.0], damping=[0.1])
    body = Geometry(
        positions=[[0, 0, 0], [1.1, 0, 0]],
        masses=[1.0, 2.0],
        fixed=[1, 0],
        velocities=[[0, 0, 0], [0, 0.3, 0]],
        labels=("anchor", "bob"),
        bars=bars,
    )
    values = {
        "geometry": body,
        "signals": {"u": Signal(name="u", values=[0.0, 1.0, -1.0], dt=0.1, interpolation="hold")},
        "actuators": (
            Actuator(node=1, signal="u", type="force", axes=(True, False, False)),
        ),
        "gravity": (0.0, -9.81, 0.0),
        "duration": 0.5,
        "dt": 0.01,
        "save_interval": 0.05,
        "integrator": "verlet",
    }  # fmt: skip
    return Experiment(**(values | settings))


def made(tmp_path, scene, **settings):
    """Run as the host does; the path of the result."""
    out = tmp_path / "out.h5"
    simulate(
        scene, Producer(), target=out, provenance=Provenance("pybullet"), owner="pybullet",
        overwrite=True, options={"start": "half-kick"}, **settings,
    )  # fmt: skip
    return out


# --- what is written -------------------------------------------------------


def test_the_file_says_what_pybullet_did(pb_run):
    run = pb_run(spring())
    assert (run.n_frames, run.n_nodes, run.dims) == (11, 2, 2)
    np.testing.assert_allclose(run.time, 0.05 * np.arange(11), atol=1e-12)
    np.testing.assert_array_equal(run.positions()[0], [[0, 0], [1.1, 0]])
    np.testing.assert_array_equal(run.velocities()[0], [[0, 0], [0, 0.3]])
    # The recorded input is the commanded one.
    held = np.array([0.0, 1.0, -1.0])[np.minimum(np.arange(11) // 2, 2)]
    with h5py.File(run.path) as file:
        np.testing.assert_array_equal(file["inputs/u/value"][:, 0], held)
        assert set(file["time_series/elements/bars"]) == {"length", "strain", "force"}
        assert "total_energy" in file["time_series/system"]
    assert "PyBullet 3" in run.notes[0]
    assert "all forces (bars, hinges, bends, weight, drag, actuators) are OpenPRC's" in run.notes[0]
    assert "leapfrog, of second order" in run.notes[1]
    plain = pb_run(spring(), start="plain")
    assert "semi-implicit Euler, of first order" in plain.notes[1]


def test_two_runs_have_one_digest(tmp_path):
    digests = []
    for number in range(2):
        (tmp_path / str(number)).mkdir()
        with h5py.File(made(tmp_path / str(number), spring())) as file:
            digests.append(content_digest(file))
    assert digests[0] == digests[1]


def test_planar_and_storage_settings_are_respected(pb_run):
    scene = spring()
    run = pb_run(replace(scene, stored=replace(scene.stored, velocities=False, elements=False)))
    with h5py.File(run.path) as file:
        assert "velocities" not in file["time_series/nodes"]
        assert "elements" not in file["time_series"]


def test_another_integrator_is_said(pb_run):
    scene = spring(integrator="rk4")
    (hint,) = Runner().supports(scene)
    assert (hint.code, hint.level) == ("PYB-INTEGRATOR", "hint")
    run = pb_run(scene)
    assert any("names the integrator 'rk4'" in note for note in run.notes)
    np.testing.assert_array_equal(run.positions(), pb_run(spring()).positions())


def test_nothing_of_bullet_is_left_on():
    with client.direct_client("a test") as (bullet, number):
        bullet.setGravity(0, 0, -9.81, physicsClientId=number)
        bullet.setPhysicsEngineParameter(numSubSteps=4, physicsClientId=number)
        world = NeutralWorld(
            bullet, number, step=0.01, positions=np.zeros((2, 3)),
            velocities=np.array([[0.0, 0, 0], [3e5, 1e-6, 0]]), masses=np.array([0.0, 1.0]),
        )  # fmt: skip
        settings = bullet.getPhysicsEngineParameters(physicsClientId=number)
        assert settings["numSubSteps"] == 0
        assert settings["fixedTimeStep"] == 0.01
        assert settings["gravityAccelerationZ"] == 0.0
        x, v = np.zeros((2, 3)), np.zeros((2, 3))
        for _ in range(1000):
            world.step(x, np.zeros((2, 3)))
        world.read_positions(x)
        world.read_velocities(v)
        # No damping, no limit of 100 m/s, and nothing falls asleep at 1e-6 m/s.
        np.testing.assert_array_equal(v[1], [3e5, 1e-6, 0])
        np.testing.assert_allclose(x[1], [3e6, 1e-5, 0], rtol=1e-12)
        np.testing.assert_array_equal(world.rows, [1])
        # Put somewhere, a node keeps the last digit of what it is given.
        place, speed = np.array([1 / 3, np.pi, 1e-9]), np.array([1 / 7, -np.e, 1e9])
        world.put(1, place, speed)
        world.read_positions(x)
        world.read_velocities(v)
        np.testing.assert_array_equal([x[1], v[1]], [place, speed])


# --- what is refused -------------------------------------------------------


def with_bars(scene, **columns):
    body = scene.geometry
    return replace(scene, geometry=replace(body, bars=replace(body.bars, **columns)))


def folded(**columns):
    hinges = Hinges(indices=[[0, 1, 2, 3]], stiffness=[1.0], rest_angle=[3.0], **columns)
    body = Geometry(
        positions=[[0, 0, 0], [1, 0, 0], [0.5, 1, 0], [0.5, -1, 0.1]],
        masses=np.ones(4),
        fixed=[1, 1, 0, 0],
        hinges=hinges,
    )
    return spring(geometry=body, actuators=(), signals={})


REFUSED = {
    "PYB-RIGID-BARS": (
        lambda: with_bars(spring(), rigid=[True]),
        "1 rigid bars: PyBullet offers no constraint",
        "stiffness about 100 times",
    ),
    "PYB-RIGID-HINGES": (lambda: folded(rigid=[True]), "1 rigid hinges", "demlat"),
    "PYB-HINGE-STOPS": (
        lambda: folded(limit_low=[1.0], limit_high=[5.0]),
        "hard stops on 1 hinges, which act by impacts",
        "enhanced-linear",
    ),
    "PYB-CONTACT": (
        lambda: replace(
            spring(),
            collision=Collision(enabled=True, radius=0.1),
            geometry=replace(spring().geometry, collidable=[True, True]),
        ),
        "do not obey the coefficient of restitution",
        "set enable_collision to false",
    ),
    "PYB-PRECISION": (
        lambda: spring(precision="float32"),
        "the precision 'float32'",
        "export.precision",
    ),
    "PYB-INTEGRATOR": (
        lambda: spring(integrator="dop853"),
        "the integrator 'dop853'",
        "--integrator verlet",
    ),
    "DEM-UNSTABLE-STEP": (
        lambda: spring(dt=0.25, save_interval=0.25),
        "dt = 0.25 s with the integrator 'verlet', whose motion would blow up",
        "step_check",
    ),
    "DEM-DEAD-FORCE": (
        lambda: spring(actuators=(Actuator(node=0, signal="u", type="force"),)),
        "a force on x of node 0, which is fixed",
        "no effect",
    ),
}


@pytest.mark.parametrize("code", REFUSED)
def test_refusals(code, tmp_path):
    make, found, fix = REFUSED[code]
    scene = make()
    (finding,) = (item for item in Runner().supports(scene) if item.level == "error")
    assert finding.code == code
    assert found in finding.found
    assert finding.expected
    assert fix in finding.fix
    with pytest.raises(UnsupportedScene, match="pybullet cannot model it"):
        made(tmp_path, scene)
    assert list(tmp_path.iterdir()) == []


def test_contact_is_refused_for_a_reason():
    """A ball with restitution 1 bounces higher than it fell from, with default settings."""
    with client.direct_client("a test") as (bullet, number):
        bullet.setGravity(0, 0, -9.81, physicsClientId=number)
        plane = bullet.createCollisionShape(bullet.GEOM_PLANE, physicsClientId=number)
        ball = bullet.createCollisionShape(bullet.GEOM_SPHERE, radius=0.01, physicsClientId=number)
        bodies = [
            bullet.createMultiBody(mass, shape, -1, [0, 0, height], physicsClientId=number)
            for mass, shape, height in ((0.0, plane, 0.0), (1.0, ball, 1.01))
        ]
        for body in bodies:
            bullet.changeDynamics(
                body, -1, restitution=1.0, linearDamping=0.0, angularDamping=0.0,
                physicsClientId=number,
            )  # fmt: skip
        heights = []
        for _ in range(720):
            bullet.stepSimulation(number)
            heights.append(bullet.getBasePositionAndOrientation(bodies[1], number)[0][2] - 0.01)
    assert max(heights[:240]) < 1.05
    assert max(heights) > 1.2


def test_without_pybullet(monkeypatch, tmp_path):
    def absent(name):
        raise ModuleNotFoundError(f"No module named {name!r}", name=name)

    monkeypatch.setattr(client, "import_module", absent)
    with pytest.raises(MissingDependency, match="running an experiment needs PyBullet"):
        made(tmp_path, spring())
    assert list(tmp_path.iterdir()) == []


# --- runs that end early -------------------------------------------------------


def test_a_run_that_blows_up_keeps_its_frames(tmp_path):
    scene = spring(dt=0.25, save_interval=0.25, duration=100.0, step_check="warn")
    with pytest.raises(Diverged, match="node 1 left the range of plausible positions") as caught:
        made(tmp_path, scene)
    assert "stability limit at the start is 0.19" in caught.value.fix
    assert "bar 0 between nodes 0 and 1" in caught.value.fix
    (partial,) = tmp_path.iterdir()
    with Trajectory(partial, allow_incomplete=True) as run:
        assert run.n_frames > 10
        assert np.isfinite(run.positions()).all()


def test_a_run_that_is_stopped_leaves_a_readable_prefix(tmp_path, monkeypatch):
    monkeypatch.setattr("openprc_pybullet.runner.FLUSH_S", 0.0)

    def stop(fraction, message):
        if fraction > 0.5:
            raise KeyboardInterrupt

    scene = spring()
    with pytest.raises(KeyboardInterrupt):
        made(tmp_path, scene, progress=stop)
    (partial,) = tmp_path.iterdir()
    whole_folder = tmp_path / "whole"
    whole_folder.mkdir()
    with (
        Trajectory(partial, allow_incomplete=True) as run,
        Trajectory(made(whole_folder, scene)) as whole,
    ):
        assert run.status == "interrupted"
        assert 5 < run.n_frames < 11
        np.testing.assert_array_equal(run.positions(), whole.positions()[: run.n_frames])


def test_frames_that_wait_are_kept_when_a_step_fails(tmp_path, monkeypatch):
    from openprc_pybullet.half_kick import HalfKickLoop

    advance = HalfKickLoop.advance

    def failing(self, count):
        if self.number >= 20:
            raise KeyboardInterrupt
        advance(self, count)

    monkeypatch.setattr(HalfKickLoop, "advance", failing)
    with pytest.raises(KeyboardInterrupt):
        made(tmp_path, spring())
    (partial,) = tmp_path.iterdir()
    with Trajectory(partial, allow_incomplete=True) as run:
        assert run.n_frames == 5


# --- the command line -------------------------------------------------------


def test_command_line(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(warnings, "showwarning", warnings.showwarning)  # main() replaces it
    save_experiment(spring(), tmp_path)
    with pytest.raises(SystemExit) as stop:
        main(["run", str(tmp_path), "--producer", "pybullet", "-o", "start=plain", "--json"])
    assert not stop.value.code
    said = json.loads(capsys.readouterr().out)
    assert said["producer"] == "pybullet"
    with Trajectory(tmp_path / "output" / "simulation.h5") as run:
        assert run.n_frames == 11
    assert any("semi-implicit Euler" in note for note in said["notes"])
    with pytest.raises(SystemExit) as stop:
        main(["run", str(tmp_path), "--producer", "pybullet", "-o", "start=late"])
    assert stop.value.code == 2
    assert "half-kick" in capsys.readouterr().err
    assert [option.name for option in RUN_OPTIONS] == ["start"]
