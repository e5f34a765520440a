"""Extreme scenes on the whole way to a file: nothing wrong is left as a result without a word."""

from dataclasses import replace

import h5py
import numpy as np
import pytest

from openprc.demlat import BarHingeModel, Engine
from openprc.demlat.models.barhinge.support import remarks
from openprc.demlat.planning.phase_drift import tolerance_remarks, turn
from openprc.demlat.planning.stability import step_limit
from openprc.errors import ConfigError, Diverged
from openprc.schema import Trajectory
from openprc.schema.experiment import save_experiment

X, Y, Z = np.eye(3)


def notes_of(scene, folder):
    """Run a scene from a folder to its file; return what the file notes."""
    save_experiment(scene, folder)
    with Trajectory(Engine(BarHingeModel, backend="cpu").run(folder).path) as run:
        return list(run.provenance["notes"])


@pytest.fixture
def fold(body):
    """Make two triangles of which one is free to turn about the crease."""

    def make(angle, *, speed=0.0, stiffness=1.0, bars=1e4, altitude=1.0, **settings):
        wing = 0.5 * X + altitude * (np.cos(angle) * Y + np.sin(angle) * Z)
        side = float(np.linalg.norm(wing))
        velocities = np.zeros((4, 3))
        velocities[3] = speed * (np.sin(angle) * Y - np.cos(angle) * Z)
        return body(
            [0 * X, X, 0.5 * X + Y, wing],
            np.ones(4),
            fixed=[True, True, True, False],
            bars=[(0, 3, bars, side, 0.0), (1, 3, bars, side, 0.0)],
            hinges=[(0, 1, 2, 3, stiffness, np.pi, 0.0)],
            velocities=velocities,
            **settings,
        )

    return make


def at_share_of_limit(scene, share, *, frames, steps=20):
    dt = share * step_limit(scene).limit
    return replace(scene, dt=dt, save_interval=steps * dt, duration=frames * steps * dt)


# --- energy that a scheme makes --------------------------------------------------------------


@pytest.mark.parametrize(("share", "check"), [(0.9, "refuse"), (1.05, "warn")])
def test_a_blow_up_that_stays_finite_is_no_result(tmp_path, fold, share, check):
    scene = fold(
        np.pi - 0.4, stiffness=200.0, bars=100.0, speed=0.1, integrator="verlet", step_check=check
    )
    save_experiment(at_share_of_limit(scene, share, frames=100), tmp_path)
    with pytest.raises(Diverged, match=r"'verlet' made \S+ J of energy by t = ") as caught:
        Engine(BarHingeModel, backend="cpu").run(tmp_path)
    assert "a hundred times what came in" in caught.value.found
    assert "use a smaller dt than" in caught.value.fix
    assert not (tmp_path / "output/simulation.h5").exists()
    with h5py.File(tmp_path / "output/simulation.h5.partial") as file:
        assert file.attrs["status"] == "failed"
        assert np.isfinite(file["time_series/nodes/positions"][()]).all()


def test_energy_that_rk4_takes_is_told_in_numbers(tmp_path, lattice):
    scene = replace(lattice(3), integrator="rk4")
    notes = notes_of(at_share_of_limit(scene, 0.6, frames=20), tmp_path)
    (note,) = [note for note in notes if " of what moves back and forth" in note]
    assert note.startswith("the integrator 'rk4' took ")
    finer = notes_of(at_share_of_limit(scene, 0.05, frames=20), tmp_path / "finer")
    assert not any(" of what moves back and forth" in note for note in finer)


# --- hinges ----------------------------------------------------------------------------------


def test_a_hinge_through_itself_is_noted(tmp_path, fold):
    notes = notes_of(fold(0.3, speed=6.0, stiffness=0.5, duration=0.2), tmp_path)
    (note,) = [note for note in notes if "folded shut" in note]
    assert note.startswith("1 hinges folded shut and through themselves, the first of them hinge 0")
    flat = notes_of(fold(np.pi + 0.3, speed=6.0, duration=0.2), tmp_path / "flat")
    assert not any("folded shut" in note for note in flat)


@pytest.mark.parametrize(("altitude", "told"), [(1e-2, False), (1e-4, True)])
def test_thin_wings_are_remarked_on(fold, altitude, told):
    found = [
        r for r in remarks(fold(np.pi - 0.1, altitude=altitude, stiffness=1e-6)) if "wing" in r
    ]
    assert len(found) == told
    if told:
        assert "1 hinges have a wing close to the crease line, such as hinge 0 (8.9e-05" in found[0]


# --- bars without length ---------------------------------------------------------------------


def test_a_bar_through_no_length_keeps_its_closed_form(simulate, body):
    # Without a rest length a bar is a linear spring, also where its ends meet.
    scene = body([0 * X, X], [1, 1], fixed=[1, 0], bars=[(0, 1, 100.0, 0.0, 0.0)], duration=1.0)
    run = simulate(scene)
    np.testing.assert_allclose(run.x[:, 1, 0], np.cos(10.0 * run.t), atol=1e-7)


def test_a_bar_that_starts_without_length_is_refused(tmp_path, body):
    scene = body([0 * X, 0 * X], [1, 1], fixed=[1, 0], bars=[(0, 1, 100.0, 1.0, 0.0)])
    with pytest.raises(ConfigError, match="the nodes of element 0 are at one point"):
        save_experiment(scene, tmp_path)


# --- time ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("scheme", "error"),
    [
        ("verlet", lambda p: p**3 / 24),
        ("rattle", lambda p: p**3 / 24),
        ("midpoint", lambda p: -(p**3) / 12),
        ("rk4", lambda p: -(p**5) / 120),
    ],
)
def test_turns_of_an_undamped_mode_have_the_series_of_the_schemes(scheme, error):
    for phase in (0.02, 0.05):
        assert turn(scheme, phase) - phase == pytest.approx(error(phase), rel=5e-3, abs=1e-15)


def test_turns_are_those_of_runs(simulate, body):
    for scheme in ("rk4", "verlet", "pefrl"):
        scene = body(
            [0 * X, 1.1 * X], [1, 1], fixed=[1, 0], bars=[(0, 1, 100.0, 1.0, 0.0)],
            integrator=scheme, dt=0.05, save_interval=0.05, duration=50.0,
        )  # fmt: skip
        run = simulate(scene)
        swing = run.x[:, 1, 0] - 1.0
        angle = turn(scheme, 0.5)
        # x_(n+1) + x_(n-1) = 2 r cos(angle) x_n, less a growth r^2
        rows = np.stack([swing[1:-1], -swing[:-2]], axis=1)
        trace, grown = np.linalg.lstsq(rows, swing[2:], rcond=None)[0]
        assert np.arccos(trace / (2.0 * np.sqrt(grown))) == pytest.approx(angle, abs=1e-9)


def test_long_undamped_runs_are_told_to_get_out_of_phase(body):
    def found(**settings):
        damping = settings.pop("c", 0.0)
        scene = body(
            [0 * X, 1.1 * X], [1, 1], fixed=[1, 0], bars=[(0, 1, 100.0, 1.0, damping)],
            **{"dt": 0.01, "save_interval": 1.0, "duration": 1e4} | settings,
        )  # fmt: skip
        return [remark for remark in remarks(scene) if "too far or too little" in remark]

    (remark,) = found(integrator="verlet")
    assert remark.startswith("verlet turns the fastest mode (10 rad/s, undamped) by 42 rad")
    assert "in the 1,000,000 steps of this run" in remark
    (remark,) = found(integrator="respa")
    assert remark.startswith("respa turns the fastest mode (10 rad/s, undamped) by 42 rad")
    assert not found(integrator="verlet", duration=30.0)
    assert not found(integrator="verlet", c=0.1)
    assert not found(integrator="pefrl")
    assert not found(integrator="dop853")


@pytest.mark.parametrize(("scheme", "told"), [("verlet", True), ("pefrl", False)])
def test_free_bodies_that_turn_many_times_are_told_to_get_out_of_phase(
    simulate, body, scheme, told
):
    rate, k = 50.0, 1e4
    r = k / (2.0 * k - rate**2)
    scene = body(
        [-r * X, r * X], [1, 1], bars=[(0, 1, k, 1.0, 0.0)],
        velocities=[-rate * r * Y, rate * r * Y], integrator=scheme, dt=5e-4, duration=5.0,
    )  # fmt: skip
    model = BarHingeModel(scene)
    last = [block.x[-1].copy() for _, block in model.blocks()][-1]
    off = abs(np.angle(np.exp(1j * (np.arctan2(last[1, 1], last[1, 0]) - rate * 5.0))))
    found = [remark for remark in model.closing_remarks() if "the body turned" in remark]
    assert len(found) == told
    assert (off > 5e-3) == told
    if told:
        assert found[0].startswith("the body turned at up to 50 rad/s, and 'verlet' turned it some")


def test_what_rounding_and_tolerances_add_up_to_is_told(body):
    scene = body(
        [0 * X, 1.1 * X], [1, 1], fixed=[1, 0], bars=[(0, 1, 100.0, 1.0, 0.0)],
        precision="float32", dt=1e-3, save_interval=1.0, duration=200.0,
    )  # fmt: skip
    (found,) = [remark for remark in remarks(scene) if "rounds to" in remark]
    assert "each of 200,000 steps rounds to float32: up to 0.024 of the motion" in found
    assert not [r for r in remarks(replace(scene, precision="float64")) if "rounds to" in r]
    assert not [r for r in remarks(replace(scene, damping=0.1)) if "rounds to" in r]
    adaptive = replace(scene, integrator="rk45", tolerance=1e-5, precision="float64")
    (told,) = tolerance_remarks(adaptive, 10_000)
    assert "rk45 took 10,000 steps, each with an error of up to 1e-05 of the motion" in told
    assert "up to 0.1 by the end" in told
    assert list(tolerance_remarks(adaptive, 100)) == []
    assert list(tolerance_remarks(replace(adaptive, damping=0.1), 10_000)) == []


# --- places and sizes ------------------------------------------------------------------------


def test_motion_far_from_the_origin_is_told_to_be_lost_in_rounding(tmp_path, body):
    far = 1e13 * X
    scene = body(
        [far, far + 1.5 * X], [1, 1], fixed=[1, 0], bars=[(0, 1, 100.0, 1.0, 0.0)], duration=0.1
    )
    notes = notes_of(scene, tmp_path)
    assert any("coordinates reach 1e+13 m and are rounded to 0.0022 m" in note for note in notes)


@pytest.mark.parametrize("size", [1e-6, 1e3])
def test_bodies_of_every_size_move_alike(simulate, body, size):
    def run(scale):
        return simulate(
            body(
                [0 * X, 1.1 * scale * X, scale * (X + 1.2 * Y)],
                [1, 1, 2],
                fixed=[1, 0, 0],
                bars=[(0, 1, 100.0, scale, 0.1), (1, 2, 50.0, scale, 0.1)],
                velocities=[0 * X, scale * Y, 0 * X],
                duration=0.5,
            )
        )

    np.testing.assert_allclose(run(size).x / size, run(1.0).x, atol=1e-11)
