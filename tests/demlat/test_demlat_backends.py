"""Three back ends, one physics: compiled CPU kernels, CUDA, and energies differentiated by JAX."""

import os
import subprocess
import sys
from pathlib import Path

import backend_scenes
import numpy as np
import pytest
from backend_scenes import scene_of_every_law, scene_of_linear_laws, scene_with_printed_damping

from openprc.demlat.backends.devices import n_nvidia_devices
from openprc.demlat.compiled.jit import entry
from openprc.demlat.models.barhinge.assembly import assemble
from openprc.demlat.models.barhinge.dynamics_kernels import evaluate, observe
from openprc.demlat.models.barhinge.tables import LEDGER, LEDGER_STRIDE
from openprc.demlat.observables import hinge_angles
from openprc.schema.experiment_checks import check_experiment

COLUMNS = ("x", "v", "length", "tension", "angle", "moment", "energy", "ledger")
SUPPORT = Path(backend_scenes.__file__).parent


def agree(result, reference, tolerance=1e-12):
    scale = np.abs(reference).max(initial=0.0)
    np.testing.assert_allclose(result, reference, rtol=0, atol=tolerance * scale)


def columns_of(blocks):
    copies = [[np.array(c) for c in block[: len(COLUMNS)]] for _, block in blocks]
    return dict(zip(COLUMNS, map(np.concatenate, zip(*copies, strict=True)), strict=True))


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    """What numba's CUDA simulator makes of the scenes, in a process of its own."""
    pytest.importorskip("numba.cuda", reason="this numba has no CUDA target")
    out = tmp_path_factory.mktemp("cuda") / "simulated.npz"
    path = os.pathsep.join([str(SUPPORT), *sys.path])
    subprocess.run(
        [sys.executable, SUPPORT / "cuda_simulated.py", out],
        env=os.environ | {"NUMBA_ENABLE_CUDASIM": "1", "PYTHONPATH": path},
        check=True,
        timeout=300,
    )
    with np.load(out) as results:
        return dict(results)


def simulated_run(results, name):
    return {column: results[f"{name} {number}"] for number, column in enumerate(COLUMNS)}


@pytest.fixture(scope="module")
def in_jax():
    pytest.importorskip("jax", reason="JAX is not installed")
    from openprc.demlat.backends.jax_run import JaxRun

    return columns_of(JaxRun(scene_of_every_law()).blocks())


@entry
def at_start(stamp):
    def run(body, x, v, force, rates, energy):
        _ = stamp
        evaluate(body, x, v, force, rates, 0.0, 0.0, 1e-3)
        observe(body, x, v, energy)

    return run


@pytest.fixture(scope="module")
def on_cpu():
    """Forces [N], powers [W] and energies [J] of the compiled kernels at t = 0."""
    scene = scene_of_every_law()
    assembly = assemble([scene])
    body, state, unit = assembly.body, assembly.state, assembly.scaler
    place_in_plain_python(scene, assembly)
    force = np.zeros_like(state.x)
    rates, energy = np.zeros(len(LEDGER) * LEDGER_STRIDE), np.zeros(4 * LEDGER_STRIDE)
    at_start(body, state.x, state.v, force, rates, energy)
    return {
        "forces": assembly.packing.nodes(force)[0] * unit.force,
        "powers": rates.reshape(len(LEDGER), -1).sum(axis=1) * unit.moment / unit.time,
        "energy": energy.reshape(4, -1).sum(axis=1) * unit.moment,
        "tension": body.scratch[1] * unit.force,
        "moment": body.scratch[3] * unit.moment,
    }


def place_in_plain_python(scene, assembly):
    """Put driven coordinates where the first samples of their signals say."""
    unit, x, v = assembly.scaler, assembly.state.x, assembly.state.v
    line, speed = scene.signals["line"], scene.signals["speed"]
    at = assembly.packing.at
    x[at(1, 0, 0)] = line.values[0, 0] / unit.length
    v[at(1, 0, 0)] = np.diff(line.values[:2, 0])[0] / line.dt / unit.velocity
    x[at(2, 1, 0)] = scene.signals["steps"].values[0, 0] / unit.length
    v[at(2, 1, 0)] = 0.0
    for axis in (0, 2):
        v[at(3, axis, 0)] = speed.values[0, axis] / unit.velocity


# --- the scenes ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "make", [scene_of_every_law, scene_with_printed_damping, scene_of_linear_laws]
)
def test_the_scenes_are_sound(make):
    check_experiment(make())


def test_walls_cables_and_struts_are_all_at_work(on_cpu):
    scene = scene_of_every_law()
    law = scene.geometry.bars.law
    for kind in ("cable", "strut"):
        assert (on_cpu["tension"][law == kind] == 0.0).any()
        assert (on_cpu["tension"][law == kind] != 0.0).any()
    hinges = scene.geometry.hinges
    angles = hinge_angles(scene.geometry.positions[None], hinges)[0]
    walled = hinges.law == "enhanced-linear"
    assert (angles[walled] > hinges.limit_high[walled]).any()
    assert (angles[walled] < hinges.limit_low[walled]).any()
    assert (np.abs(angles[walled] - np.pi) < 1).any()


# --- forces and energies at an instant ----------------------------------------------------------


def test_derivatives_of_the_energy_are_the_compiled_forces(on_cpu):
    jax = pytest.importorskip("jax", reason="JAX is not installed")
    from openprc.demlat.backends.jax_body import parameters_of
    from openprc.demlat.backends.jax_run import JaxRun

    run = JaxRun(scene_of_every_law())
    p = parameters_of(run.experiment)

    def rates_at_start(p):
        table = run.table(p)
        state = run.start(p, table)
        times = (0.0, 0.0, run.h)
        slopes = run.slopes(p, table, state.x, state.v, times, ledger=True)
        return slopes.v, slopes.ledger

    with jax.enable_x64(True):
        acceleration, powers = map(np.asarray, jax.jit(rates_at_start)(p))
    free = ~run.experiment.held_axes
    agree(acceleration, np.where(free, on_cpu["forces"] / p["masses"][:, None], 0.0))
    agree(powers, on_cpu["powers"])


def test_cuda_forces_are_the_compiled_forces(on_cpu, simulated):
    # Of fixed nodes the reactions are compared as well; weight is not among them.
    agree(simulated["laws forces"], on_cpu["forces"])


@pytest.mark.parametrize("name", ["in_jax", "simulated"])
def test_observables_at_the_start_agree(name, on_cpu, request):
    first = request.getfixturevalue(name)
    if name == "simulated":
        first = simulated_run(first, "laws")
    for column in ("energy", "tension", "moment"):
        agree(first[column][0], on_cpu[column])


def test_printed_damping_is_the_printed_formula(simulated):
    scene = scene_with_printed_damping()
    jax = pytest.importorskip("jax", reason="JAX is not installed")
    from openprc.demlat.backends.jax_body import JaxBody, parameters_of

    geometry, bars = scene.geometry, scene.geometry.bars
    i, j = bars.indices.T
    x, v = geometry.positions, geometry.velocities
    along = x[j] - x[i]
    length = np.linalg.norm(along, axis=1)
    pull = (bars.stiffness * (length - bars.relaxed_length) / length)[:, None] * along
    expected = np.zeros_like(x)
    for end, sign in ((i, 1.0), (j, -1.0)):
        coefficient = 2.0 * bars.damping * np.sqrt(geometry.masses[end] * bars.stiffness)
        np.add.at(expected, end, sign * (pull + coefficient[:, None] * (v[j] - v[i])))
    agree(simulated["printed forces"], expected)
    p = parameters_of(scene)
    with jax.enable_x64(True):
        forces, losses = map(np.asarray, jax.jit(JaxBody(scene).forces)(p, x, v))
    agree(forces, expected)
    spring = np.zeros_like(x)
    np.add.at(spring, i, pull)
    np.add.at(spring, j, -pull)
    agree(losses, np.array([0.0, -np.sum((expected - spring) * v), 0.0]))


# --- runs ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("column", COLUMNS)
def test_jax_and_cuda_run_alike(column, in_jax, simulated):
    agree(in_jax[column], simulated_run(simulated, "laws")[column])


def test_cuda_runs_as_the_compiled_kernels_do(simulate, simulated):
    run, other = simulate(scene_of_linear_laws()), simulated_run(simulated, "linear")
    for column in COLUMNS:
        agree(other[column], getattr(run, column))


def test_cuda_closes_the_energy_balance(simulated):
    run = simulated_run(simulated, "printed")
    balance = run["energy"].sum(axis=1) - run["ledger"][:, 0] + run["ledger"][:, 1:].sum(axis=1)
    np.testing.assert_allclose(balance, balance[0], rtol=1e-6)
    assert run["ledger"][-1, 2] > 0.01 * balance[0]


def test_the_same_bits_every_time_and_in_one_block(simulated):
    for column, values in simulated_run(simulated, "laws").items():
        for name in ("laws again", "laws in one block"):
            np.testing.assert_array_equal(simulated_run(simulated, name)[column], values)


def test_the_model_runs_on_cuda_when_asked(simulated):
    np.testing.assert_array_equal(simulated["from the model"], simulated["linear 0"][:2])
    assert "numba simulates CUDA" in str(simulated["remarks"])


def test_a_run_on_cuda_that_blows_up_is_refused(simulated):
    message = str(simulated["message"])
    assert "left the range of plausible positions along" in message
    assert "use a smaller dt than 1 s" in message


@pytest.mark.skipif(n_nvidia_devices() == 0, reason="no NVIDIA device was found")
@pytest.mark.parametrize("one_block", [False, True])
def test_a_real_device_runs_as_its_simulator(one_block, simulated):
    from openprc.demlat.backends.cuda_run import CudaRun

    run = columns_of(CudaRun(scene_of_every_law(), one_block=one_block).blocks())
    again = columns_of(CudaRun(scene_of_every_law(), one_block=one_block).blocks())
    for column, values in simulated_run(simulated, "laws").items():
        agree(run[column], values)
        np.testing.assert_array_equal(run[column], again[column])


@pytest.mark.slow
def test_every_law_runs_alike_on_the_cpu(simulate, in_jax, simulated):
    run = simulate(scene_of_every_law())
    for column in COLUMNS:
        agree(in_jax[column], getattr(run, column))
        agree(simulated_run(simulated, "laws")[column], getattr(run, column))
