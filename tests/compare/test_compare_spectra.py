"""Spectra of sinusoids are where they should be and as large; energies and drives are judged."""

import numpy as np
import pytest
from compared_files import REST, compared, motion, write

from openprc.compare.deviations.spectra import segment_length, spectral_peaks

T = 0.01 * np.arange(2000)


def swing(frequency, *, amplitude=0.1, phase=0.0, t=T):
    angle = 2 * np.pi * frequency * t[:, None, None] + phase + np.zeros((len(t), 6, 3))
    return REST + amplitude * np.sin(angle)


def test_frequencies_and_powers_are_those_of_the_sinusoids(tmp_path):
    a = write(tmp_path / "a.h5", T, swing(3.1))
    b = write(tmp_path / "b.h5", T, swing(3.13, amplitude=0.2, phase=0.4))
    found = compared(a, b).spectra
    assert found.dominant == (pytest.approx(3.1, rel=1e-4), pytest.approx(3.13, rel=1e-4))
    assert found.dominant_difference == pytest.approx(0.03 / 3.1, rel=0.02)
    # Over all frequencies a density adds up to the variance: three axes of a^2 / 2.
    for density, amplitude in ((found.reference, 0.1), (found.other, 0.2)):
        assert density.sum() * found.resolution == pytest.approx(1.5 * amplitude**2, rel=1e-3)


def test_the_density_is_that_of_welch(tmp_path):
    from scipy.signal import coherence, welch

    rng = np.random.default_rng(0)
    x = REST + rng.normal(size=(2000, 6, 3))
    y = 0.5 * x + rng.normal(size=x.shape)
    pair = compared(
        write(tmp_path / "a.h5", T, x), write(tmp_path / "b.h5", T, y), segment=256, match="index"
    )
    flat = [p.reshape(len(T), -1) for p in (x, y)]
    options = {"fs": 100.0, "nperseg": 256, "axis": 0}
    for density, data in zip((pair.spectra.reference, pair.spectra.other), flat, strict=True):
        f, wanted = welch(data, **options)
        np.testing.assert_allclose(density, wanted.sum(axis=1) / 6, rtol=1e-9)
    np.testing.assert_allclose(pair.spectra.frequencies, f)
    _, each = coherence(*flat, **options)
    weight = np.sqrt(welch(flat[0], **options)[1] * welch(flat[1], **options)[1])
    wanted = (each * weight).sum(axis=1) / weight.sum(axis=1)
    np.testing.assert_allclose(pair.spectra.coherence, wanted, rtol=1e-9)
    assert pair.spectra.n_segments == 14


def test_segments_with_gaps_are_left_out(tmp_path):
    x = swing(3.1)
    seen = np.ones(x.shape[:2], dtype="u1")
    seen[100:110, 2] = 0
    pair = compared(write(tmp_path / "a.h5", T, x), write(tmp_path / "b.h5", T, x, seen=seen))
    assert any("segments with gaps are left out" in note for note in pair.notes)
    assert pair.spectra.dominant_difference == 0.0
    seen[::100] = 0
    none = compared(write(tmp_path / "c.h5", T, x), write(tmp_path / "d.h5", T, x, seen=seen),
                    match="index")  # fmt: skip
    assert none.spectra is None
    assert any("every segment has gaps" in note for note in none.notes)


def test_slow_motion_is_told_to_be_unresolved(tmp_path):
    x = swing(0.25)
    pair = compared(write(tmp_path / "a.h5", T, x), write(tmp_path / "b.h5", T, x))
    assert any("hardly resolve: raise segment" in note for note in pair.notes)


def test_long_records_have_segments_spread_over_them(monkeypatch, tmp_path):
    from openprc.compare.deviations import spectra

    monkeypatch.setattr(spectra, "SAMPLES", 6 * 2 * 18 * 64)
    x = swing(3.1)
    pair = compared(write(tmp_path / "a.h5", T, x), write(tmp_path / "b.h5", T, x), segment=64)
    assert pair.spectra.n_segments == 6
    assert pair.spectra.dominant_difference == 0.0


def test_lengths_of_segments_have_small_factors():
    assert segment_length(10**6, None) == 8192
    assert segment_length(300, None) == 100
    assert segment_length(9, None) == 8
    assert segment_length(50, 64) == 50


def test_a_flat_spectrum_has_no_peak():
    assert len(spectral_peaks(np.arange(9.0), np.zeros(9))) == 0


# --- energies ------------------------------------------------------------------------------------


def test_energy_drift_is_told(tmp_path):
    x = motion(T)[0]
    kinetic = 2.0 * np.sin(T) ** 2
    potential = 2.0 * np.cos(T) ** 2
    good = {"kinetic_energy": kinetic, "potential_energy": potential}
    bad = {**good, "potential_energy": potential + 0.01 * T}
    pair = compared(
        write(tmp_path / "a.h5", T, x, system=good), write(tmp_path / "b.h5", T, x, system=bad)
    )
    assert pair.energy.reference.relative < 1e-12
    assert pair.energy.other.largest == pytest.approx(0.01 * T[-1])
    assert pair.energy.other.scale == pytest.approx(2.0, rel=1e-4)
    differences = {item.name: item for item in pair.energy.differences}
    assert differences["kinetic_energy"].rms == 0.0
    assert differences["total_energy"].rms == pytest.approx(np.sqrt(np.mean((0.01 * T) ** 2)))


def test_work_and_losses_belong_to_the_balance(tmp_path):
    x = motion(T)[0]
    system = {"total_energy": 1.0 + T - 0.3 * T, "work_in": T, "dissipated": 0.3 * T}
    a = write(tmp_path / "a.h5", T, x, system=system)
    pair = compared(a, a)
    assert pair.energy.other.largest < 1e-12
    assert pair.energy.other.of == "total_energy - work_in + dissipated"
    driven = write(tmp_path / "b.h5", T, x, system={"total_energy": T + 1.0}, drive=T)
    assert compared(a, driven).energy.other.of == "total_energy of a driven body"


def test_kinetic_energy_is_computed_from_masses_and_velocities(tmp_path):
    x, v = motion(T)
    mass = np.array([1.0, 2, 3, 4, 5, 6])
    energy = 0.5 * np.einsum("tnd,tnd,n->t", v, v, mass)
    a = write(tmp_path / "a.h5", T, x, system={"kinetic_energy": energy})
    b = write(tmp_path / "b.h5", T, x, velocities=v, mass=1e3 * mass, mass_unit="g")
    pair = compared(a, b)
    (found,) = pair.energy.differences
    assert found.computed == ("other",)
    assert found.relative < 1e-12
    assert compared(a, write(tmp_path / "c.h5", T, x)).energy.differences == ()


def test_energies_are_interpolated_with_the_clock(tmp_path):
    x = motion(T)[0]
    t = 0.004 + 0.01 * np.arange(1990)
    a = write(tmp_path / "a.h5", T, x, system={"total_energy": np.sin(3 * T)})
    b = write(tmp_path / "b.h5", t, motion(t)[0], system={"total_energy": np.sin(3 * t)})
    assert compared(a, b).energy.differences[0].rms < 1e-7


# --- drives --------------------------------------------------------------------------------------


def drive_of(tmp_path, name, drive, **options):
    t = options.pop("t", T)
    return write(tmp_path / f"{name}.h5", t, motion(t)[0], drive=drive, **options)


def test_drives_are_same_scaled_or_different(tmp_path):
    u = np.sin(5 * T) + 0.3
    base = drive_of(tmp_path, "base", u)
    assert compared(base, drive_of(tmp_path, "same", u)).drive.verdict == "same"
    pair = compared(base, drive_of(tmp_path, "scaled", 2.5 * u))
    assert (pair.drive.verdict, pair.drive.factor) == ("scaled", pytest.approx(2.5))
    pair = compared(base, drive_of(tmp_path, "different", np.cos(4 * T)))
    assert pair.drive.verdict == "different"
    assert any("driven differently" in note for note in pair.notes)
    two = drive_of(tmp_path, "two", np.stack([u, u], axis=1))
    assert compared(base, two).drive.verdict == "different"
    bare = write(tmp_path / "bare.h5", T, motion(T)[0])
    assert "bare.h5 does not say" in compared(base, bare).drive.text
    assert compared(bare, bare).drive.verdict == "none"


def test_sequences_decide_where_both_have_them(tmp_path):
    k = np.arange(200) / 7.0
    base = drive_of(tmp_path, "base", np.sin(5 * T), sequence=np.sin(k)[:, None])
    other = drive_of(tmp_path, "other", np.sin(5 * T) ** 3, sequence=np.sin(k)[:150, None])
    pair = compared(base, other)
    assert pair.drive.verdict == "same"
    assert "150 symbols agree" in pair.drive.text


def test_drives_between_frames_are_the_same_within_a_tolerance(tmp_path):
    t = 0.004 + 0.01 * np.arange(1990)
    pair = compared(
        drive_of(tmp_path, "a", np.sin(5 * T)), drive_of(tmp_path, "b", np.sin(5 * t), t=t)
    )
    assert pair.drive.verdict == "same"
    assert "between frames" in pair.drive.text
