"""What the frames of a run say about it: numbers, energies, folds, roundings."""

from dataclasses import replace

import numpy as np
import pytest

from openprc.demlat.models.barhinge.run_watch import RunWatch
from openprc.demlat.models.barhinge.tables import FrameBuffer
from openprc.errors import Diverged

X, Y, Z = np.eye(3)
N_FRAMES = 11


@pytest.fixture
def scene(body):
    return body([0 * X, X], [1.0, 1.0], fixed=[True, False], bars=[(0, 1, 100.0, 1.0, 0.0)])


def frames(*, n_hinges=0, count=N_FRAMES, **columns):
    """Return frames of two nodes on a bar at rest, with the columns that matter."""
    out = FrameBuffer.for_frames(count, n_nodes=2, dims=3, n_bars=1, n_hinges=n_hinges, n_bends=0)
    for column in out:
        column[...] = 0.0
    out.x[:, 1, 0] = 1.0
    out.length[:] = 1.0
    for name, values in columns.items():
        getattr(out, name)[...] = values
    return out


def energies(kinetic, potential):
    table = np.zeros((len(kinetic), 4))
    table[:, 0], table[:, 1] = kinetic, potential
    return table


def remarks_of(scene, *blocks, **more):
    watch = RunWatch(scene, **more)
    first = 0
    for block in blocks:
        assert watch.sound(first, block) == len(block.x)
        first += len(block.x)
    watch.close()
    return list(watch.remarks())


SWING = np.linspace(0.0, np.pi, N_FRAMES)
SOUND = energies(np.sin(SWING) ** 2, np.cos(SWING) ** 2)


def test_a_sound_run_has_nothing_to_tell(scene):
    assert remarks_of(scene, frames(energy=SOUND)) == []


def test_a_body_at_rest_has_nothing_to_tell(scene):
    assert remarks_of(scene, frames()) == []


# --- numbers ---------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("v", r"a velocity \(number 0\) is no finite number by t = 0.04 s"),
        ("tension", "the force of a bar"),
        ("moment", "the torque of a hinge"),
        ("energy", "an energy"),
        ("ledger", "work or a loss"),
    ],
)
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_not_finite_stop_the_run_at_their_frame(scene, name, words, value):
    block = frames(n_hinges=1)
    getattr(block, name)[4:, 0] = value
    watch = RunWatch(scene)
    sound = watch.sound(0, block)
    assert sound == 4
    rest = FrameBuffer(*(column[sound:] for column in block))
    error = watch.not_finite(sound, rest)
    with pytest.raises(Diverged, match=words):
        raise error
    assert error.expected == "finite numbers"
    assert "too large for float64" in error.fix


def test_opposite_infinities_are_seen_as_well(scene):
    block = frames()
    block.v[7, 0], block.v[8, 0] = np.inf, -np.inf
    assert RunWatch(scene).sound(0, block) == 7


# --- energy ----------------------------------------------------------------------------------


def test_energy_that_the_scheme_made_is_no_result(scene):
    growing = np.exp(2.0 * SWING)
    words = (
        r"'rk4' made 534 J of energy by t = 0.1 s: from t = 0.08 s on there is a hundred times"
        " what came in"
    )
    with pytest.raises(Diverged, match=words) as caught:
        remarks_of(scene, frames(energy=energies(growing, 0.0)))
    assert caught.value.expected == "energy that only actuators and gravity bring in"
    assert "use a smaller dt than 0.001 s" in caught.value.fix


def test_energy_of_an_actuator_is_no_gap(scene):
    growing = np.exp(SWING)
    ledger = np.zeros((N_FRAMES, 5))
    ledger[:, 0] = growing - 1.0
    assert remarks_of(scene, frames(energy=energies(growing, 0.0), ledger=ledger)) == []
    ledger[:, 3] = 10.0 - 10.0 * np.exp(-SWING)  # and a damper takes some of it
    lossy = growing - ledger[:, 3]
    block = frames(energy=energies(np.abs(lossy), np.minimum(lossy, 0.0) * 2.0), ledger=ledger)
    assert remarks_of(scene, block) == []


@pytest.mark.parametrize(("share", "told"), [(0.019, False), (0.05, True), (0.9, True)])
@pytest.mark.parametrize(("sign", "done"), [(1.0, "made"), (-1.0, "took")])
def test_smaller_gaps_are_remarked_on(scene, share, told, sign, done):
    block = frames(energy=SOUND)
    block.energy[-1, 1] += sign * share
    found = remarks_of(scene, block, scheme="PyBullet")
    assert len(found) == told
    if told:
        assert found[0].startswith(f"PyBullet {done} {share:.3g} J of energy by t = 0.1 s, ")
        assert "of what moves back and forth or was brought in: a smaller dt" in found[0]


def test_losses_that_are_hardly_known_are_no_blow_up(scene):
    # A stiff damper takes all there is in a step; its share of the ledger is three times that.
    dying = np.exp(-5.0 * SWING)
    ledger = np.zeros((N_FRAMES, 5))
    ledger[:, 2] = 3.0 * (1.0 - dying)
    (found,) = remarks_of(scene, frames(energy=energies(dying, 0.0), ledger=ledger))
    assert found.startswith("the integrator 'rk4' made 2 J of energy by t = 0.1 s, 0.67 of")


def test_blocks_are_weighed_together(scene):
    whole = frames(energy=energies(np.ones(N_FRAMES), np.linspace(0.0, 0.1, N_FRAMES)))
    parts = [FrameBuffer(*(column[a:b] for column in whole)) for a, b in ((0, 1), (1, 6), (6, 11))]
    assert remarks_of(scene, whole) == remarks_of(scene, *parts) != []


def test_rounding_is_no_gap(scene):
    # A body far up has much energy, and little that moves.
    rng = np.random.default_rng(1)
    noise = 1e9 * np.finfo(float).eps * rng.standard_normal(N_FRAMES)
    assert remarks_of(scene, frames(energy=energies(0.0 * noise, 1e9 + noise))) == []


def test_energies_of_a_body_at_rest_are_none(scene):
    # A bar of 100 N/m that is 1e-12 of its length too long, and more from frame to frame.
    assert remarks_of(scene, frames(energy=energies(0.0 * SWING, 5e-23 * np.exp(SWING)))) == []


# --- hinges ----------------------------------------------------------------------------------


def test_hinges_that_fold_through_themselves_are_named(scene):
    angle = np.column_stack([np.full(N_FRAMES, 3.0), 0.5 - 0.1 * np.arange(N_FRAMES)])
    angle = np.mod(angle, 2.0 * np.pi)
    (found,) = remarks_of(scene, frames(n_hinges=2, angle=angle))
    assert found.startswith(
        "1 hinges folded shut and through themselves, the first of them hinge 1"
    )
    assert "by t = 0.06 s" in found
    assert "limits of the hinge" in found


def test_folding_through_is_seen_between_blocks(scene):
    blocks = [frames(n_hinges=1, count=1, angle=angle) for angle in (0.1, 6.2)]
    (found,) = remarks_of(scene, *blocks)
    assert "hinge 0 by t = 0.01 s" in found


def test_passing_flat_is_no_folding_through(scene):
    angle = np.pi + np.linspace(-1.0, 1.0, N_FRAMES)[:, None]
    assert remarks_of(scene, frames(n_hinges=1, angle=angle)) == []


# --- bars and coordinates --------------------------------------------------------------------


def test_bars_that_lose_their_direction_are_named(scene):
    block = frames()
    block.length[6] = 5e-4
    (found,) = remarks_of(scene, block)
    assert found.startswith("bar 0 had hardly any length by t = 0.06 s: its force turns about")


def test_bars_whose_ends_go_through_each_other_are_named(scene):
    x = 0.3 - 0.1 * np.arange(N_FRAMES) + 0.05
    through = frames(length=np.abs(x)[:, None])
    through.x[:, 1, 0] = x
    through.v[:, 1, 0] = -10.0
    (found,) = remarks_of(scene, through)
    assert found.startswith("bar 0 had hardly any length by t = 0.04 s, one of 1 that went through")
    parts = [FrameBuffer(*(c[a:b] for c in through)) for a, b in ((0, 4), (4, 5), (5, 11))]
    assert remarks_of(scene, *parts) == [found]


def test_bars_that_turn_half_round_between_frames_are_not(scene):
    turns = np.pi * np.arange(N_FRAMES) + 0.1
    spin = frames()
    spin.x[:, 1] = np.stack([np.cos(turns), np.sin(turns), 0.0 * turns], axis=1)
    spin.v[:, 1] = 314.0 * np.stack([-np.sin(turns), np.cos(turns), 0.0 * turns], axis=1)
    assert remarks_of(scene, spin) == []


def test_motion_that_rounding_swallows_is_remarked_on(scene):
    far = frames(v=1e-5)
    far.x[...] += 1e10
    (found,) = remarks_of(scene, far)
    assert found.startswith("coordinates reach 1e+10 m and are rounded to 2.2e-06 m")
    assert "nothing moves more than 1e-08 m in a step" in found
    still = frames(v=1e-30)
    still.x[...] += 1e10
    assert remarks_of(scene, still) == []  # what rests loses nothing
    # In single precision displacements are stored, which are small.
    assert remarks_of(replace(scene, precision="float32"), far) == []


def test_small_motion_costs_schemes_that_choose_their_steps_accuracy(scene):
    block = frames()
    block.x[5:, 1, 0] += 1e-7
    small = replace(scene, integrator="dop853", tolerance=1e-6)
    (found,) = remarks_of(small, block)
    assert "less than 0.001 of the mean bar" in found
    assert "lower the tolerance" in found
    assert remarks_of(scene, block) == []
