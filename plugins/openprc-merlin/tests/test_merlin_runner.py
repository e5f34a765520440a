"""The runner from the outside: what it writes, its options, and what it refuses."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from openprc_merlin import RUN_OPTIONS
from openprc_merlin.producer import Producer

from openprc.errors import ConfigError, NotConverged, UnsupportedScene
from openprc.hooks.options import check_options
from openprc.hooks.protocols import Runner
from openprc.hooks.running import run_experiment
from openprc.schema import Provenance, Trajectory, TrajectoryWriter, validate_file
from openprc.schema.experiment import Actuator, Collision, Experiment, Signal, save_experiment
from openprc.schema.geometry import Bars, Bends, Geometry, Hinges

B, H, K = 1.0, 0.3, 100.0
L0 = np.hypot(B, H)


def truss(drive="force", n=20, **changes):
    """The von Mises truss: the apex is pushed or moved down, its other axes are held."""
    x = np.array([[-B, 0, 0], [B, 0, 0], [0, 0, H]])
    ramp = np.linspace(0, 1, n + 1)
    values = {"force": -2.0 * ramp, "position": H - 0.6 * ramp}[drive]
    signals = {
        "sides": Signal(name="sides", values=np.zeros(1), dt=1.0, unit="m"),
        "drive": Signal(name="drive", values=values, dt=1.0),
    }
    actuators = (
        Actuator(node=2, signal="sides", type="position", axes=(True, True, False)),
        Actuator(node=2, signal="drive", type=drive, axes=(False, False, True)),
    )
    body = Geometry(
        positions=x,
        masses=np.ones(3),
        fixed=[True, True, False],
        bars=Bars(indices=[[0, 2], [1, 2]], stiffness=[K, K], rest_length=[L0, L0]),
    )
    experiment = Experiment(
        geometry=body,
        signals=signals,
        actuators=actuators,
        duration=float(n),
        dt=1.0,
        save_interval=1.0,
    )
    return replace(experiment, **changes)


def push(w):
    z = H - w
    return 2 * K * z * (L0 / np.hypot(B, z) - 1.0)


@pytest.fixture
def ran(tmp_path):
    """Run an experiment and open what came of it."""
    opened = []

    def run(experiment, **options):
        target = tmp_path / f"run{len(opened)}.h5"
        given = {name.replace("_", "-"): value for name, value in options.items()}
        with TrajectoryWriter(target, provenance=Provenance("merlin"), verify=_whole) as writer:
            Producer().run(experiment, writer, seed=None, options=given)
            notes = "\n".join(writer.notes)
        trajectory = Trajectory(target)
        opened.append(trajectory)
        trajectory.text = notes
        return trajectory

    yield run
    for trajectory in opened:
        trajectory.close()


def _whole(path):
    assert [f for f in validate_file(path).findings if f.level == "error"] == []


def test_producer_is_a_runner():
    assert isinstance(Producer(), Runner)
    assert not list(Producer().supports(truss()))


def test_run_along_the_arc(ran):
    tr = ran(truss(n=30), initial_load_factor=0.05)
    assert (tr.n_frames, tr.dims, tr.time_kind, tr.time_unit) == (31, 3, "pseudo", "1")
    np.testing.assert_array_equal(tr.time, np.arange(31))
    load = tr.input("load")
    assert (load.columns, load.unit, load.targets) == (("load factor",), "1", ("node 2",))
    w = H - tr.positions()[:, 2, 2]
    np.testing.assert_allclose(2.0 * load.value[:, 0], push(w), atol=1e-10)
    assert w[0] == 0.0 == load.value[0, 0]
    length = np.hypot(B, H - w)
    np.testing.assert_allclose(tr.element("bars", "length"), np.stack([length] * 2, 1))
    np.testing.assert_allclose(tr.element("bars", "force")[:, 0], K * (length - L0), atol=1e-11)
    np.testing.assert_allclose(tr.element("bars", "strain")[:, 1], length / L0 - 1, atol=1e-13)
    energy = K * (length - L0) ** 2
    np.testing.assert_allclose(tr.system("potential_energy"), energy, atol=1e-12)
    np.testing.assert_allclose(tr.system("elastic_energy_bars"), energy, atol=1e-12)
    negative = tr.system("negative_eigenvalues")
    turned = np.flatnonzero(np.diff(load.value[:, 0]) < 0)
    assert (negative[: turned[0]] == 0).all()
    assert (negative[turned[0] + 1 : turned[-1]] == 1).all()
    assert tr.system("residual").max() < 1e-11
    assert tr.channels == ()
    assert "load factor is sought" in tr.text


def test_first_increment_is_that_of_the_signal(ran):
    straight = ran(truss(n=20)).input("load").value[:, 0]
    half = Signal(name="drive", values=np.r_[0, np.linspace(-0.05, -2.0, 20)], dt=1.0)
    scene = truss(n=20)
    scene = replace(scene, signals={**scene.signals, "drive": half})
    short = ran(scene).input("load").value[:, 0]
    # The predictor aims at the factor; the truss gets softer on the way.
    assert straight[1] == pytest.approx(0.05, rel=0.1)
    assert short[1] == pytest.approx(0.025, rel=0.1)
    long = ran(truss(n=20), arc_length=0.01).positions()[:, 2, 2]
    np.testing.assert_allclose(np.diff(long), -0.01, rtol=1e-6)


def test_run_through_positions(ran):
    tr = ran(truss("position", n=12))
    assert tr.inputs == ("drive",)
    np.testing.assert_allclose(tr.input().value[:, 0], H - 0.05 * np.arange(13), atol=1e-15)
    assert (tr.input().quantity, tr.input().unit) == ("position", "m")
    w = H - tr.positions()[:, 2, 2]
    np.testing.assert_allclose(w, 0.05 * np.arange(13), atol=1e-15)
    np.testing.assert_allclose(tr.channel("reaction")[:, 0], push(w), atol=1e-11)
    assert tr.channel_columns("reaction") == ("2 z",)


def test_load_that_the_body_cannot_carry_makes_it_jump(ran):
    for unstable in ("follow", "settle"):
        tr = ran(truss(n=20), control="load", unstable=unstable)
        assert tr.inputs == ("drive",)
        w = H - tr.positions()[:, 2, 2]
        np.testing.assert_allclose(push(w), 0.1 * np.arange(21), atol=1e-9)
        assert (w[9] < 0.13, w[10] > 0.6) == (True, True)
        assert set(tr.system("negative_eigenvalues")) == {0.0}
        assert "increment 10 is a jump: 0.558 J" in tr.text
        assert tr.text.count("jump") == 1


def test_search_that_fails_keeps_the_frames_before(ran, tmp_path):
    # Three iterations reach the first states; near the limit point they are too few.
    with pytest.raises(NotConverged, match="no equilibrium at increment 10") as caught:
        ran(truss(n=20), control="load", max_iterations=4, min_step=1e-3)
    assert "the way is cut down to 0.001 of an increment" in str(caught.value)
    assert "unstable=settle" in str(caught.value)
    assert "frames up to there are kept" in str(caught.value)
    with Trajectory(tmp_path / "run0.h5.partial", allow_incomplete=True) as kept:
        assert kept.n_frames == 10


def test_arc_that_fails_says_how_short_it_got(ran):
    with pytest.raises(NotConverged, match=r"the step is down to 0\.2 of the first one") as caught:
        ran(truss(n=20), max_iterations=2, tolerance=1e-300, min_step=0.3)
    assert "increment 1, load factor 0" in str(caught.value)
    assert "smaller initial-load-factor" in str(caught.value)


def test_path_ends_early_where_it_is_told_to(ran):
    tr = ran(truss(n=60), max_displacement=0.2, arc_length=0.01)
    w = H - tr.positions()[:, 2, 2]
    assert w[-1] >= 0.2 > w[-2]
    assert "max-displacement is 0.2" in tr.text
    tr = ran(truss(n=60), max_load=0.4, arc_length=0.01)
    assert tr.input("load").value[-1, 0] >= 0.4 > tr.input("load").value[-2, 0]
    tr = ran(truss(n=60), unstable="stop", arc_length=0.01)
    assert tr.system("negative_eigenvalues")[-2:].tolist() == [0.0, 1.0]
    assert "the state is unstable" in tr.text


def test_frame_0_is_in_balance(ran):
    tr = ran(truss(gravity=(0.0, 0.0, -0.3)))
    w = H - tr.positions()[:, 2, 2]
    np.testing.assert_allclose(push(w), 0.3 + 2.0 * tr.input("load").value[:, 0], atol=1e-10)
    assert w[0] > 0.01
    assert "frame 0 is the equilibrium nearby" in tr.text
    weight = 0.3 * tr.positions()[:, :, 2].sum(axis=1)
    np.testing.assert_allclose(tr.system("gravity_energy"), weight, atol=1e-12)


def test_what_has_no_effect_is_said(ran):
    scene = truss(damping=0.1)
    body = replace(scene.geometry, velocities=[[0, 0, 0], [0, 0, 0], [0, 0, 1.0]])
    scene = replace(scene, geometry=replace(body, bars=replace(body.bars, damping=[1.0, 0.0])))
    findings = list(Producer().supports(scene))
    assert {f.level for f in findings} == {"warning"}
    assert [f.path for f in findings] == [
        *("nodes/velocities", "physics.damping", "elements/bars/damping"),
    ]
    assert findings[0].found == "an initial velocity, which has no effect on equilibria"
    words = "without effect in a quasi-static run: an initial velocity, drag, damping of bars"
    assert words in ran(scene).text


def test_planar_scene_stays_in_its_plane(ran):
    x = np.array([[-B, 0, 0], [B, 0, 0], [0, H, 0]])
    body = Geometry(
        positions=x,
        masses=np.ones(3),
        fixed=[True, True, False],
        bars=Bars(indices=[[0, 2], [1, 2]], stiffness=[K, K], rest_length=[L0, L0]),
    )
    drive = Signal(name="push", values=[0.0, -1.0], dt=5.0)
    scene = Experiment(
        geometry=body,
        signals={"push": drive},
        actuators=(Actuator(node=2, signal="push", type="force", axes=(False, True, False)),),
        duration=5.0,
        dt=1.0,
        save_interval=1.0,
    )
    tr = ran(scene)
    assert tr.dims == 2
    np.testing.assert_allclose(
        tr.input("load").value[:, 0], push(H - tr.positions()[:, 2, 1]), atol=1e-11
    )


def test_bends_are_followed_too(ran):
    # A cantilever of two segments with one bend: F l cos(phi) = k phi.
    body = Geometry(
        positions=[[0, 0, 0], [1, 0, 0], [2, 0, 0]],
        masses=np.ones(3),
        fixed=[True, True, False],
        bars=Bars(indices=[[0, 1], [1, 2]], stiffness=[1e6, 1e6], rest_length=[1.0, 1.0]),
        bends=Bends(indices=[[0, 1, 2]], stiffness=[0.5]),
    )
    signal = Signal(name="push", values=[0.0, -0.5], dt=10.0)
    scene = Experiment(
        geometry=body,
        signals={"push": signal},
        actuators=(Actuator(node=2, signal="push", type="force", axes=(False, True, False)),),
        duration=10.0,
        dt=1.0,
        save_interval=1.0,
    )
    tr = ran(scene, control="load")
    phi = np.pi - tr.element("bends", "angle")[:, 0]
    np.testing.assert_allclose(0.5 * phi, 0.05 * np.arange(11) * np.cos(phi), atol=1e-6)
    assert (np.diff(tr.system("elastic_energy_bends")) > 0).all()


def test_run_from_a_folder(tmp_path):
    save_experiment(truss(n=8), tmp_path / "exp")
    made = run_experiment(
        tmp_path / "exp", producer="merlin", options={"control": "arc-length", "increments": "5"}
    )
    with Trajectory(made.path) as tr:
        assert tr.n_frames == 6
        assert '"increments": 5' in str(tr.provenance).replace("'", '"')


# --- refusals ---------------------------------------------------------------------------------


def four(**hinge):
    x = np.array([[-1.0, 0, 0], [0, 1, 0], [0, -1, 0], [1, 0, 0]])
    columns = {"indices": [[1, 2, 0, 3]], "stiffness": [1.0], "rest_angle": [np.pi]} | hinge
    return Geometry(positions=x, masses=np.ones(4), hinges=Hinges(**columns))


def velocity(scene):
    drive = Actuator(node=2, signal="sides", type="velocity", axes=(False, False, True))
    return replace(scene, actuators=(scene.actuators[0], drive))


def dead(scene):
    force = Actuator(node=2, signal="drive", type="force", axes=(True, False, True))
    return replace(scene, actuators=(scene.actuators[0], force))


def rigid(scene):
    return replace(scene, geometry=replace(scene.geometry, bars=_rigid(scene.geometry.bars)))


def _rigid(bars):
    return replace(bars, rigid=[True, False])


def touching(scene):
    body = replace(scene.geometry, collidable=np.ones(3, bool))
    return replace(scene, geometry=body, collision=Collision(enabled=True, radius=0.1))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (rigid, "1 rigid bars"),
        (lambda s: replace(s, geometry=four(rigid=[True])), "1 rigid hinges"),
        (lambda s: replace(s, geometry=four(limit_low=[1.0])), "hard stops on 1 hinges"),
        (touching, "contact between 3 collidable nodes"),
        (velocity, "velocity actuators on 1 nodes"),
        (lambda s: replace(s, actuators=()), "nothing drives the body"),
        (dead, "a force on x of node 2, which is held there"),
    ],
)
def test_refused_with_the_reason(change, words, ran):
    findings = list(Producer().supports(change(truss())))
    assert all(f.level == "error" and f.expected and f.fix for f in findings)
    assert any(words in finding.found for finding in findings)
    with pytest.raises(UnsupportedScene, match=words):
        ran(change(truss()))


@pytest.mark.parametrize(
    ("drive", "options", "words"),
    [
        ("position", {"control": "arc-length"}, "position actuators that move"),
        ("force", {"control": "displacement"}, "without a position actuator that moves"),
        ("position", {"control": "load"}, "without a force on an axis that can move"),
        ("position", {"increments": 5}, "increments=5 with control=displacement"),
        ("force", {"control": "load", "max-load": 2.0}, "max-load=2.0 with control=load"),
        ("force", {"unstable": "settle"}, "unstable=settle along an arc"),
        (
            "force",
            {"arc-length": 0.1, "initial-load-factor": 0.1},
            "both arc-length and initial-load-factor",
        ),
        ("force", {"initial-load-factor": 0.0}, "load factor of the first increment, not 0"),
        ("force", {"increments": 0}, "increments=0(?s:.)*a number above 0"),
        ("force", {"tolerance": -1.0}, "tolerance=-1.0(?s:.)*a number above 0"),
    ],
)
def test_option_that_does_not_fit(ran, drive, options, words):
    with pytest.raises(ConfigError, match=words):
        ran(truss(drive), **options)


def test_arc_without_a_load_at_its_end(ran):
    scene = truss()
    back = Signal(name="drive", values=[0.0, -1.0, 0.0], dt=10.0)
    with pytest.raises(ConfigError, match="without a force at the end of the run"):
        ran(replace(scene, signals={**scene.signals, "drive": back}), control="arc-length")
    with pytest.raises(ConfigError, match="an experiment of 1 frame"):
        ran(replace(scene, duration=0.0))


def test_load_on_what_nothing_holds(ran):
    scene = truss()
    loose = replace(scene.geometry, fixed=[False] * 3)
    with pytest.raises(ConfigError, match="which nothing holds"):
        ran(replace(scene, geometry=loose, actuators=scene.actuators[1:]))


def test_the_file_says_which_loads_the_path_goes_through(ran):
    """An increment is a length along the path: n of them may go far beyond the forces given."""
    far = ran(truss(n=60), initial_load_factor=0.05)
    load = far.input("load").value
    assert load.max() > 1.0
    assert f"load factors from {load.min():.4g} to {load.max():.4g}, beyond the forces" in far.text
    assert "max-load=1 ends the path there" in far.text
    told = ran(truss(n=60), initial_load_factor=0.05, max_load=1.0)
    assert told.n_frames < far.n_frames
    assert "the load factor is" in told.text
    assert "beyond the forces" not in told.text
    assert "load factors" not in ran(truss("position")).text


def test_every_option_has_a_default_that_runs(ran):
    from openprc_merlin import openprc_producers

    spec = openprc_producers()[0]
    assert spec.run_options == RUN_OPTIONS
    tr = ran(truss(n=3), **check_options(spec, spec.run_options, {}))
    assert tr.n_frames == 4
