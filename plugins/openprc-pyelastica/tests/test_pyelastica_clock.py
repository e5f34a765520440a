"""Times of the samples: repeated, missing, too many, too few."""

from __future__ import annotations

import numpy as np
from openprc_pyelastica import clock


def test_repeated_times_keep_the_last_sample_and_tell_the_difference(
    tmp_path, wave, run_import, notes, check
):
    arrays = {key: np.concatenate([array[:1], array]) for key, array in wave().items()}
    arrays["position"][0] += 0.25
    np.savez(tmp_path / "a.npz", **arrays, energy=np.arange(41.0))
    run = run_import(tmp_path / "a.npz")
    check(run)
    assert "up to 0.25 m away from the later one" in notes(run)
    assert run.channel("energy")[:2, 0].tolist() == [1.0, 2.0]


def test_repeats_and_late_keys_together(tmp_path, wave, run_import, extension):
    arrays = {key: np.concatenate([array[:1], array]) for key, array in wave().items()}
    late = np.arange(40.0)[:, np.newaxis] * np.ones(5)
    np.savez(tmp_path / "a.npz", **arrays, dilatation=late)
    values, _, comment = extension(run_import(tmp_path / "a.npz"), "rod0.dilatation")
    # Sample j of the short array belongs to sample j + 1 of the others, which is frame j.
    np.testing.assert_array_equal(values[:, 0], np.arange(40.0))
    assert "row 0" not in comment


def test_one_time_too_many(tmp_path, wave, run_import, notes):
    arrays = wave()
    np.savez(
        tmp_path / "a.npz",
        time=arrays["time"],
        position=arrays["position"][1:],
        velocity=arrays["velocity"][1:],
        step=np.arange(40),
        energy=arrays["time"],
    )
    run = run_import(tmp_path / "a.npz")
    assert "one sample more of times than of positions" in notes(run)
    np.testing.assert_array_equal(run.time, arrays["time"][1:])
    np.testing.assert_array_equal(run.positions()[0], arrays["position"][1].T)
    np.testing.assert_array_equal(run.channel("energy")[:, 0], arrays["time"][1:])


def test_one_position_too_many(tmp_path, wave, run_import, notes):
    arrays = wave()
    np.savez(
        tmp_path / "a.npz",
        time=arrays["time"][1:],
        position=arrays["position"],
        velocity=arrays["velocity"],
    )
    run = run_import(tmp_path / "a.npz")
    assert "one sample more of positions than of times" in notes(run)
    np.testing.assert_array_equal(run.positions()[0], arrays["position"][1].T)
    np.testing.assert_array_equal(run.velocities()[0], arrays["velocity"][1].T)


def test_dt_places_samples_without_times(tmp_path, wave, run_import):
    arrays = wave()
    np.savez(tmp_path / "a.npz", position=arrays["position"])
    run = run_import(tmp_path / "a.npz", dt=0.1)
    np.testing.assert_array_equal(run.time, 0.1 * np.arange(40))


def test_dt_that_agrees_with_the_file_is_harmless(tmp_path, wave, run_import, check):
    np.savez(tmp_path / "a.npz", **wave())
    check(run_import(tmp_path / "a.npz", dt=0.05))


def test_named_keys(tmp_path, wave, run_import, check):
    arrays = wave()
    np.savez(
        tmp_path / "a.npz",
        clock=arrays["time"],
        shape=arrays["position"],
        position=arrays["position"] + 1,
    )
    run = run_import(tmp_path / "a.npz", time="clock", position="shape")
    check(run, velocities=False)


def test_two_keys_with_positions_are_told(tmp_path, wave, run_import, check, notes):
    arrays = wave()
    np.savez(tmp_path / "a.npz", **arrays, position_collection=arrays["position"] + 1)
    run = run_import(tmp_path / "a.npz")
    check(run)
    assert "position was taken for the positions, not position_collection" in notes(run)


def test_a_clock_aligns_to_the_end():
    ticks = clock.Clock(np.arange(4.0), 5, np.array([0, 2, 3, 4]))
    values, first = ticks.align(np.arange(4.0), key="a")
    assert (values.tolist(), first) == ([1.0, 2.0, 3.0], 1)
