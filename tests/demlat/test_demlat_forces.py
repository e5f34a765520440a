"""Forces outside the engine's loop: gradients of the energy, losses, drives, and refusals."""

import subprocess
import sys
import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from openprc.demlat.forces import ForceField
from openprc.errors import ConfigError, UnsupportedScene
from openprc.schema import Experiment
from openprc.schema.experiment import Actuator, Collision, Signal
from openprc.schema.geometry import Bars, Bends, Geometry, Hinges

LAWS = ("linear", "cubic", "cable", "strut", "ogden")


def tangle(n=9, *, damped=False, only_bars=False, **settings):
    """A body with every law, or linear bars alone (which compile faster); all nodes free."""
    rng = np.random.default_rng(7)
    positions = rng.uniform(0.0, 1.0, (n, 3))
    pairs = np.array([(i, j) for i in range(n) for j in range(i)])
    law = np.resize(("linear",) if only_bars else LAWS, len(pairs))
    lengths = np.linalg.norm(positions[pairs[:, 1]] - positions[pairs[:, 0]], axis=1)
    on = float(damped)
    body = Geometry(
        positions=positions,
        masses=rng.uniform(0.5, 2.0, n),
        bars=Bars(
            indices=pairs,
            stiffness=rng.uniform(50.0, 100.0, len(pairs)),
            rest_length=lengths * rng.uniform(0.8, 1.2, len(pairs)),
            prestress=rng.uniform(-0.1, 0.1, len(pairs)),
            damping=on * rng.uniform(0.1, 1.0, len(pairs)),
            law=law,
            stiffness_cubic=np.where(law == "cubic", 300.0, 0.0),
            damping_cubic=np.where(law == "cubic", on, 0.0),
        ),
        hinges=Hinges(
            indices=[[0, 1, 2, 3], [4, 5, 6, 7]],
            stiffness=[2.0, 3.0],
            rest_angle=[3.0, 2.0],
            damping=[0.3 * on, 0.2 * on],
            law=["linear", "enhanced-linear"],
            limit_low=[0.0, 1.0],
            limit_high=[2 * np.pi, 5.0],
        ),
        bends=Bends(
            indices=[[1, 4, 7], [2, 3, 8]],
            stiffness=[1.5, 2.5],
            rest_angle=[np.pi, 2.0],
            damping=[0.1 * on, 0.4 * on],
        ),
    )
    if only_bars:
        body = replace(body, hinges=Hinges(), bends=Bends())
    values = {"gravity": (0.3, -0.2, -9.81), "duration": 1.0, "dt": 1e-3, "save_interval": 0.1}
    return Experiment(geometry=body, **(values | settings))


def somewhere(scene, *, seed=1, by=0.02):
    """Positions near the start, and velocities."""
    rng = np.random.default_rng(seed)
    shape = scene.geometry.positions.shape
    return scene.geometry.positions + by * rng.normal(size=shape), rng.normal(size=shape)


@pytest.fixture(scope="module")
def field():
    return ForceField(tangle())


# --- forces and energies ------------------------------------------------------------------------


def test_forces_are_minus_the_gradient_of_the_energy(field):
    """By central differences with steps h and 2 h, which are off by O(h^4)."""
    x, _ = somewhere(field.experiment)
    at_rest = np.zeros_like(x)

    def potential(moved):
        return field.energies(moved, at_rest)[1:].sum()

    h = 1e-4
    gradient = np.zeros_like(x)
    for at in np.ndindex(x.shape):
        shift = np.zeros_like(x)
        shift[at] = h
        near = potential(x + shift) - potential(x - shift)
        far = potential(x + 2 * shift) - potential(x - 2 * shift)
        gradient[at] = (8.0 * near - far) / (12.0 * h)
    force = field(x, at_rest)
    np.testing.assert_allclose(force, -gradient, atol=1e-8 * np.abs(force).max())


def test_kinetic_energy_and_weight(field):
    x, v = somewhere(field.experiment)
    m = field.experiment.geometry.masses
    energies = field.energies(x, v)
    assert energies[0] == pytest.approx(0.5 * np.einsum("n,na,na->", m, v, v), rel=1e-13)
    assert energies[3] == pytest.approx(-np.einsum("n,na,a->", m, x, (0.3, -0.2, -9.81)))


def test_elements_push_no_net_force_and_turn_nothing():
    scene = tangle(damped=True, gravity=(0.0, 0.0, 0.0))
    x, v = somewhere(scene)
    force = ForceField(scene)(x, v)
    scale = np.abs(force).max()
    np.testing.assert_allclose(force.sum(axis=0), 0.0, atol=1e-13 * scale)
    np.testing.assert_allclose(np.cross(x, force).sum(axis=0), 0.0, atol=1e-13 * scale)


def test_what_dashpots_and_drag_take_is_the_power_of_their_forces():
    scene = tangle(damped=True, damping=0.7)
    field = ForceField(scene)
    x, v = somewhere(scene)
    lossy = field(x, v)
    power = field.power.copy()
    conservative = field(x, np.zeros_like(v))
    assert (power[[1, 2, 3, 5]] > 0).all()
    assert power[0] == power[4] == 0.0
    assert power.sum() == pytest.approx(-((lossy - conservative) * v).sum(), rel=1e-12)
    assert power[1] == pytest.approx((scene.drag[:, None] * v**2).sum(), rel=1e-13)
    assert not field.power.any()  # of the last evaluation, at rest


def test_held_nodes_feel_their_forces_too():
    """What is returned does not depend on who holds a node."""
    scene = tangle(damped=True, damping=0.7)
    n = scene.geometry.n_nodes
    signal = Signal(name="u", values=[0.1, 0.2], dt=0.5)
    held = replace(
        scene,
        geometry=replace(scene.geometry, fixed=np.arange(n) < 3),
        signals={"u": signal},
        actuators=(Actuator(node=5, signal="u"), Actuator(node=6, signal="u", type="velocity")),
    )
    x, v = somewhere(scene)
    np.testing.assert_array_equal(ForceField(held)(x, v), ForceField(scene)(x, v))


def test_vectors_give_the_same():
    scene = tangle(12, damped=True, only_bars=True)
    x, v = somewhere(scene)
    one_by_one, many = (ForceField(scene, vectors=vectors)(x, v) for vectors in (False, True))
    np.testing.assert_allclose(many, one_by_one, atol=1e-12 * np.abs(many).max())


@pytest.mark.parametrize("precision", ["float64", "float32"])
def test_a_step_of_rk4_by_hand_is_the_engines(simulate, precision):
    """The classical scheme in NumPy, with this field, against the compiled loop."""
    scene = tangle(
        damped=True, only_bars=True, damping=0.4, duration=0.05, dt=1e-3, save_interval=0.05
    )
    field, m = ForceField(replace(scene, precision=precision)), scene.geometry.masses[:, None]
    x, v, h = scene.geometry.positions.copy(), np.zeros((scene.geometry.n_nodes, 3)), 1e-3
    for _ in range(50):
        ks, ls = [], []
        for share in (0.0, 0.5, 0.5, 1.0):
            xs = x + (h * share * ks[-1] if ks else 0.0)
            vs = v + (h * share * ls[-1] if ls else 0.0)
            ks.append(vs)
            ls.append(field(xs, vs) / m)
        x = x + h / 6.0 * (ks[0] + 2.0 * ks[1] + 2.0 * ks[2] + ks[3])
        v = v + h / 6.0 * (ls[0] + 2.0 * ls[1] + 2.0 * ls[2] + ls[3])
    run = simulate(scene)
    np.testing.assert_allclose(x, run.x[-1], atol=1e-12)
    np.testing.assert_allclose(v, run.v[-1], atol=1e-11)


# --- drives -------------------------------------------------------------------------------------


def driven(kind, interpolation):
    """Two nodes without elements, one of them driven along y by 1, 3, -2 every 0.1 s."""
    body = Geometry(positions=[[0, 0, 0], [1, 2, 0]], masses=[1, 2])
    signal = Signal(name="u", values=[1.0, 3.0, -2.0], dt=0.1, interpolation=interpolation)
    return Experiment(
        geometry=body,
        signals={"u": signal},
        actuators=(
            Actuator(node=1, signal="u", type=kind, axes=(False, True, False)),
        ),
        duration=1.0,
        dt=0.01,
        save_interval=0.1,
    )  # fmt: skip


def test_a_held_force_jumps_at_its_samples():
    field = ForceField(driven("force", "hold"))
    x, v = np.zeros((2, 3)), np.array([[0.0, 0, 0], [0, 5.0, 0]])
    times = (0.0, 0.05, 0.1, 0.15, 0.2, 0.9)
    after = [field(x, v, time=t)[1, 1] for t in times]
    assert after == [1.0, 1.0, 3.0, 3.0, -2.0, -2.0]
    assert field.power[0] == -10.0
    before = [field(x, v, time=t, side="before")[1, 1] for t in times]
    assert before == [1.0, 1.0, 1.0, 3.0, 3.0, -2.0]
    assert [field.may_jump(t) for t in times] == [False, False, True, False, True, False]
    assert not field(x, v)[0].any()


def test_a_linear_force_is_interpolated_and_a_spline_ends():
    field = ForceField(driven("force", "linear"))
    x = np.zeros((2, 3))
    assert field(x, x, time=0.025)[1, 1] == pytest.approx(1.5, rel=1e-14)
    assert field.may_jump(0.1)
    scene = driven("force", "cubic")
    wave = replace(scene.signals["u"], values=[1.0, 3.0, -2.0, 0.0])
    smooth = ForceField(replace(scene, signals={"u": wave}))
    assert [smooth.may_jump(t) for t in (0.1, 0.2, 0.3)] == [False, False, True]


def test_driven_nodes_are_put_in_place():
    x, v = np.full((2, 3), 7.0), np.full((2, 3), 7.0)
    ForceField(driven("position", "linear")).place(x, v, time=0.125)
    assert x[1].tolist() == pytest.approx([7, 1.75, 7])
    assert v[1].tolist() == pytest.approx([7, -50, 7])
    assert (x[0] == 7).all()
    # A prescribed velocity begins where the node is, and is integrated exactly.
    ForceField(driven("velocity", "hold")).place(x, v, time=0.15)
    assert x[1].tolist() == pytest.approx([7, 2.0 + 0.1 + 0.15, 7])
    assert v[1].tolist() == pytest.approx([7, 3, 7])
    field = ForceField(driven("position", "hold"))
    field.place(x, v, time=0.1, side="before")
    assert x[1, 1] == 1.0
    field.place(x, v, time=0.1)
    assert x[1, 1] == 3.0


@pytest.mark.parametrize(
    ("change", "needed"),
    [
        ({}, False),
        ({"gravity": (0, 0, -9.81)}, False),
        ({"damping": 0.1}, True),
        ({"damped": True}, True),
    ],
)
def test_when_velocities_matter(change, needed):
    assert ForceField(tangle(**change)).needs_velocities is needed
    assert ForceField(driven("force", "hold")).needs_velocities


# --- use ----------------------------------------------------------------------------------------


def test_repeating_allocates_nothing(field):
    x, v = somewhere(field.experiment)
    out = np.zeros_like(x)
    assert field(x, v, out=out) is out
    tracemalloc.start()
    try:
        for _ in range(2000):  # Python itself settles meanwhile
            field(x, v, out=out)
        tracemalloc.clear_traces()
        for _ in range(500):
            field(x, v, out=out)
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 500 * x.nbytes / 8  # no array a call
    assert np.array_equal(out, field(x, v))


def test_lists_and_other_orders_are_taken(field):
    x, v = somewhere(field.experiment)
    expected = field(x, v)
    np.testing.assert_array_equal(field(x.tolist(), np.asfortranarray(v)), expected)


def test_a_planar_frame_has_three_coordinates():
    """Frames of planar scenes are as wide as the arrays that they are filled from."""
    scene = driven("force", "hold")
    assert scene.planar
    buffer = ForceField(scene).frames(2)
    assert buffer.x.shape == (2, 2, 3)


@pytest.mark.parametrize(
    ("change", "found"),
    [
        (lambda b: {"bars": replace(b.bars, rigid=np.ones(len(b.bars), bool))}, "36 rigid bars"),
        (lambda b: {"hinges": replace(b.hinges, limit_low=[1.0, 1.0])}, "hard stops on 1 hinges"),
        (
            lambda b: {"hinges": replace(b.hinges, law=["four-thirds"] * 2, limit_low=[0, 0],
                                         limit_high=[2 * np.pi] * 2)},
            "four-thirds",
        ),
    ],
)  # fmt: skip
def test_what_acts_by_constraints_is_refused(change, found):
    scene = tangle()
    scene = replace(scene, geometry=replace(scene.geometry, **change(scene.geometry)))
    with pytest.raises(UnsupportedScene, match=f"a force field cannot model it:.*{found}"):
        ForceField(scene)


def test_contact_is_refused():
    scene = tangle(collision=Collision(enabled=True, radius=0.1))
    body = replace(scene.geometry, collidable=np.ones(9, bool))
    with pytest.raises(UnsupportedScene, match="contact, which acts by impacts") as caught:
        ForceField(replace(scene, geometry=body))
    assert caught.value.fix == "set enable_collision to false"


@pytest.mark.parametrize("shape", [(8, 3), (9, 2), (27,)])
def test_arrays_of_another_shape_are_refused(field, shape):
    x, v = somewhere(field.experiment)
    with pytest.raises(ConfigError, match=r"velocities: an array of shape .*\n.*\(9, 3\)"):
        field(x, np.zeros(shape))
    with pytest.raises(ConfigError, match=r"out: an array of shape"):
        field(x, v, out=np.zeros(shape))


def test_what_cannot_be_written_to_is_refused(field):
    x, v = somewhere(field.experiment)
    for out in (np.zeros((9, 3), "f4"), np.zeros((3, 9)).T):
        with pytest.raises(ConfigError, match="no contiguous array of double precision"):
            field(x, v, out=out)


def test_a_wrong_experiment_is_refused():
    scene = tangle()
    body = replace(scene.geometry, masses=np.full(9, -1.0))
    with pytest.raises(ConfigError, match="masses"):
        ForceField(replace(scene, geometry=body))


def test_importing_compiles_nothing():
    code = "import sys, openprc.demlat.forces; print(sorted({'numba', 'scipy'} & set(sys.modules)))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"
