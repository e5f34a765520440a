"""Clocks that agree are taken as they are; others are interpolated with an error that is told."""

import numpy as np
import pytest
from compared_files import REST, compared, motion, write

from openprc.compare.alignment.interpolants import weights_at
from openprc.errors import ConfigError, NonUniformTime, SchemaError


def fine(tmp_path, *, step=0.004, n=500, start=0.0, name="fine.h5", velocities=False, t=None):
    t = start + step * np.arange(n) if t is None else t
    x, v = motion(t)
    return write(tmp_path / name, t, x, velocities=v if velocities else None)


def test_frames_of_a_finer_clock_that_agree_are_not_interpolated(tmp_path):
    reference, other = fine(tmp_path), fine(tmp_path, step=0.02, n=100, name="o.h5")
    pair = compared(reference, other)
    assert (pair.interpolant, pair.n_samples) == ("none", 100)
    assert pair.rms < 1e-14
    assert compared(other, reference).n_samples == 100


@pytest.mark.parametrize(
    ("name", "order", "velocities"),
    [("nearest", 1, False), ("linear", 2, False), ("cubic", 4, False), ("hermite", 4, True)],
)
def test_the_error_of_interpolation_has_its_order_and_is_estimated(
    tmp_path, name, order, velocities
):
    # Frames half a step apart; the deviation is all interpolation.
    errors, estimates = [], []
    for k, n in enumerate((40, 80)):
        step = 2.0 / n
        a = fine(tmp_path, step=step, n=n, name=f"a{k}.h5", velocities=velocities)
        b = fine(tmp_path, step=step, n=n, start=step / 2, name=f"b{k}.h5", velocities=velocities)
        pair = compared(a, b, interpolant=name)
        assert (pair.interpolant, pair.interpolated) == (name, "other")
        assert any("is itself wrong by about" in note for note in pair.notes)
        errors.append(pair.rms)
        estimates.append(pair.interpolation.rms)
    assert np.log2(errors[0] / errors[1]) == pytest.approx(order, abs=0.35)
    # Motion that hardly shows in every fourth frame makes the estimate careful.
    assert 0.8 < estimates[1] / errors[1] < 1.8


def test_polynomials_of_their_degree_are_reproduced():
    clock = np.array([0.0, 0.3, 0.5, 1.1, 1.4, 2.0, 2.2])
    at = np.linspace(0.0, 2.2, 41)
    for name, degree in (("linear", 1), ("cubic", 3), ("hermite", 3)):
        p = np.polynomial.Polynomial(np.arange(1.0, degree + 2.0))
        w = weights_at(clock, at, name=name)
        frames = w.first[:, None] + np.arange(w.width)
        value = (w.places * p(clock)[frames]).sum(axis=1)
        if w.velocities is not None:
            value += (w.velocities * p.deriv()(clock)[frames]).sum(axis=1)
        np.testing.assert_allclose(value, p(at), rtol=1e-12)


def test_velocities_are_used_where_they_help(tmp_path):
    a = fine(tmp_path, step=0.02, n=100, velocities=True)
    b = fine(tmp_path, step=0.02, n=100, start=0.007, name="b.h5", velocities=True)
    assert compared(a, b).interpolant == "hermite"
    # Velocities of half a step earlier, as staggered schemes have them, spoil the polynomial.
    t = 0.007 + 0.02 * np.arange(100)
    late = write(tmp_path / "c.h5", t, motion(t)[0], velocities=motion(t - 0.01)[1])
    pair = compared(a, late)
    assert pair.interpolant == "cubic"
    assert any("velocities do not predict its places" in note for note in pair.notes)


def test_the_coarser_clock_is_compared_unless_told_otherwise(tmp_path):
    reference = fine(tmp_path)
    other = fine(tmp_path, step=0.0301, n=60, name="o.h5")
    pair = compared(reference, other)
    assert (pair.n_samples, pair.interpolated) == (60, "reference")
    onto = compared(reference, other, onto="reference")
    assert (onto.interpolated, onto.n_samples) == ("other", 444)
    assert onto.rms > 100 * pair.rms


def test_uneven_clocks_are_interpolated_too(tmp_path):
    uneven = np.cumsum(np.random.default_rng(5).uniform(0.003, 0.02, size=120))
    pair = compared(fine(tmp_path), fine(tmp_path, t=uneven, name="o.h5"))
    assert pair.rms < 1e-6
    assert pair.spectra is None
    assert any("not evenly spaced" in note for note in pair.notes)


def test_only_the_overlap_counts(tmp_path):
    pair = compared(fine(tmp_path), fine(tmp_path, start=1.0, name="o.h5"))
    assert (pair.first_time, pair.n_samples) == (1.0, 250)
    window = compared(fine(tmp_path), fine(tmp_path, name="p.h5"), start=0.5, stop=1.0)
    assert (window.first_time, window.last_time) == (0.5, 1.0)


def test_no_overlap_names_both_spans(tmp_path):
    with pytest.raises(SchemaError, match=r"(?s)from 50 to 51.996 s.*fine.h5 from 0 to 1.996 s"):
        compared(fine(tmp_path), fine(tmp_path, start=50.0, name="o.h5"))
    with pytest.raises(ConfigError, match=r"between 7\.0 and 8\.0"):
        compared(fine(tmp_path), fine(tmp_path, name="p.h5"), start=7.0, stop=8.0)


def test_few_frames_limit_the_polynomial(tmp_path):
    few = fine(tmp_path, step=0.3, n=3, name="few.h5")
    other = fine(tmp_path, step=0.31, n=3, start=0.01, name="o.h5")
    assert compared(few, other).interpolant == "linear"
    with pytest.raises(ConfigError, match="the interpolant is cubic, and there are 3 frames"):
        compared(few, other, interpolant="cubic")
    with pytest.raises(ConfigError, match="the interpolant is hermite, and there are no veloc"):
        compared(few, other, interpolant="hermite")


def test_one_frame_is_a_comparison(tmp_path):
    single = write(tmp_path / "s.h5", [0.0], motion([0.0])[0])
    pair = compared(single, write(tmp_path / "o.h5", [0.0], motion([0.0])[0] + [1e-3, 0, 0]))
    assert (pair.n_samples, pair.spectra) == (1, None)
    np.testing.assert_allclose(pair.rms, 1e-3, rtol=1e-9)


@pytest.mark.parametrize("delay", [0.37, -0.2113, 0.4])
def test_a_time_shift_is_found_to_a_fraction_of_a_frame(tmp_path, delay):
    t = 0.01 * np.arange(600)
    reference = write(tmp_path / "r.h5", t, motion(t)[0])
    late = write(tmp_path / "o.h5", t, motion(t - delay)[0])
    pair = compared(reference, late, time_shift="estimate", max_shift=0.6)
    # The other clock is moved back by what it lags.
    assert pair.shift.shift == pytest.approx(-delay, abs=2e-5)
    assert pair.rms < 2e-5
    assert compared(reference, late, time_shift=-delay).rms < 2e-5
    assert compared(reference, late).rms > 1e-2


def test_a_turned_recording_is_shifted_by_its_shape(tmp_path):
    t = 0.01 * np.arange(600)
    reference = write(tmp_path / "r.h5", t, motion(t)[0])
    y = motion(t - 0.25)[0][..., [1, 2, 0]] + 3.0
    other = write(tmp_path / "o.h5", t, y)
    pair = compared(
        reference, other, time_shift="estimate", max_shift=0.6, rigid_motion="all", match="index"
    )
    assert pair.shift.shift == pytest.approx(-0.25, abs=1e-4)
    assert pair.rms < 1e-5


def test_a_periodic_motion_has_many_shifts(tmp_path):
    t = 0.01 * np.arange(600)
    x = REST + 0.1 * np.sin(2 * np.pi * t)[:, None, None]
    y = REST + 0.1 * np.sin(2 * np.pi * (t - 0.1))[:, None, None]
    pair = compared(
        write(tmp_path / "r.h5", t, x), write(tmp_path / "o.h5", t, y), time_shift="estimate"
    )
    assert any("fits nearly as well" in note and "periodic" in note for note in pair.notes)


def test_nothing_moves_and_no_shift_can_be_found(tmp_path):
    t = 0.01 * np.arange(50)
    still = write(tmp_path / "s.h5", t, np.broadcast_to(REST, (50, 6, 3)))
    with pytest.raises(SchemaError, match=r"(?s)nothing moves.*give the shift"):
        compared(still, still, time_shift="estimate")


# --- load steps ----------------------------------------------------------------------------------


def path_of(tmp_path, loads, *, name, steps=None):
    loads = np.asarray(loads, dtype="f8")
    steps = np.arange(len(loads)) if steps is None else steps
    x = REST * (1.0 + 0.2 * loads[:, None, None] ** 2)
    return write(tmp_path / name, steps, x, kind="pseudo", drive=loads, channel=loads)


def test_load_steps_and_time_do_not_mix(tmp_path):
    steps = path_of(tmp_path, np.linspace(0, 1, 500), name="p.h5")
    with pytest.raises(SchemaError, match=r"(?s)p.h5 counts load steps.*clock=\"index\""):
        compared(fine(tmp_path), steps)
    with pytest.raises(SchemaError, match="its time is pseudo, and the clock is 'time'"):
        compared(steps, steps, clock="time")
    with pytest.raises(SchemaError, match="its time is physical, and the clock is 'step'"):
        compared(fine(tmp_path), steps, clock="step")
    assert compared(fine(tmp_path), steps, clock="index").n_samples == 500
    with pytest.raises(ConfigError, match="to be estimated, and the clock is the number"):
        compared(steps, steps, time_shift="estimate")


def test_load_steps_match_by_number(tmp_path):
    loads = np.linspace(0.0, 1.0, 21)
    every = path_of(tmp_path, loads, name="all.h5")
    some = path_of(tmp_path, loads[::5], name="some.h5", steps=[0, 5, 10, 15, 20])
    pair = compared(every, some)
    assert (pair.n_samples, pair.interpolant, pair.rms) == (5, "none", 0.0)
    assert pair.clock == "number of the load step"
    assert pair.spectra is None


def test_unequal_loads_match_by_the_load(tmp_path):
    coarse = path_of(tmp_path, np.linspace(0.0, 1.0, 21), name="coarse.h5")
    odd = path_of(tmp_path, np.linspace(0.0, 1.0, 37) ** 1.5, name="odd.h5")
    pair = compared(coarse, odd)
    assert any("equal steps carry unequal loads" in note for note in pair.notes)
    assert pair.rms < 1e-12
    assert compared(coarse, odd, clock="step").rms > 1e-3
    for clock in ("input", "input:drive:c0", "channel:load:factor", "node:3:y"):
        assert compared(coarse, odd, clock=clock).relative_rms < 2e-2


def test_a_load_that_turns_cannot_match(tmp_path):
    coarse = path_of(tmp_path, np.linspace(0.0, 1.0, 21), name="coarse.h5")
    turning = path_of(tmp_path, np.sin(np.linspace(0.0, 3.0, 21)), name="turning.h5")
    with pytest.raises(NonUniformTime, match=r"(?s)turns or stands still at frame 11.*grows"):
        compared(coarse, turning, clock="input")
    assert any("up and down" in note for note in compared(turning, coarse).notes)
    falling = path_of(tmp_path, -np.linspace(0.0, 1.0, 21), name="falling.h5")
    with pytest.raises(SchemaError, match="falls in one file and grows in the other"):
        compared(coarse, falling, clock="input")
    pair = compared(falling, falling, clock="input", stop=-0.2)
    assert (pair.last_time, pair.first_time) == (-1.0, pytest.approx(-0.2))


@pytest.mark.parametrize(
    ("clock", "words"),
    [
        ("input:push", "no input 'push'"),
        ("input:drive:q", r"no column 'q'(?s:.*)one of c0"),
        ("channel:none", "no channel 'none'"),
        ("node:9:x", "there is no node '9'"),
        ("node:1:w", "there is no axis 'w'"),
    ],
)
def test_quantities_to_count_by_have_to_be_there(tmp_path, clock, words):
    path = path_of(tmp_path, np.linspace(0.0, 1.0, 5), name="p.h5")
    with pytest.raises((ConfigError, SchemaError), match=words):
        compared(path, path, clock=clock)
