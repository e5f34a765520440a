"""Symbols recognised behind a drive that is given per frame, and what a trainer says of them."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from openprc.reservoir.io.drive_shape import symbol_spacing
from openprc.reservoir.io.state_loader import StateLoader
from openprc.reservoir.training.remarks import split_remarks
from openprc.reservoir.training.split import Split
from openprc.schema import Provenance, TrajectoryWriter

T = np.arange(3000)


@pytest.fixture
def symbols():
    return np.random.default_rng(9).uniform(-1, 1, 1600)


@pytest.mark.parametrize("frames", [2, 33, 33.4, 100])
def test_held_symbols(symbols, frames):
    found = symbol_spacing(symbols[np.floor(T / frames).astype(int)])
    assert found.kind == "held"
    assert found.frames == pytest.approx(frames, rel=1e-3)
    assert found.first == np.ceil(frames)


def test_held_bits_leave_gaps_in_the_grid():
    bits = np.random.default_rng(1).integers(0, 2, 100)
    found = symbol_spacing(np.repeat(bits, 30).astype(float))
    assert (found.kind, found.frames) == ("held", 30.0)


@pytest.mark.parametrize("frames", [10, 12.5])
def test_symbols_joined_by_straight_lines(symbols, frames):
    found = symbol_spacing(np.interp(T / frames, np.arange(1600), symbols))
    assert found.kind == "joined by straight lines"
    assert found.frames == pytest.approx(frames, rel=1e-3)


@pytest.mark.parametrize("frames", [33, 33.4])
def test_symbols_joined_by_a_spline(symbols, frames):
    found = symbol_spacing(CubicSpline(np.arange(1600), symbols)(T / frames))
    assert found.kind == "joined by cubics"
    assert found.frames == pytest.approx(frames, rel=1e-3)


def test_several_columns_on_one_grid(symbols):
    both = np.repeat(symbols[:200].reshape(100, 2), 20, axis=0)
    assert symbol_spacing(both).frames == 20.0


@pytest.mark.parametrize(
    "drive",
    [
        np.sin(2 * np.pi * T / 100),
        np.random.default_rng(0).normal(size=3000),
        np.random.default_rng(0).integers(0, 2, 3000).astype(float),
        np.zeros(3000),
        np.repeat(np.random.default_rng(0).normal(size=100), np.arange(5, 105)),
    ],
    ids=["sine", "noise", "bits", "nothing", "no grid"],
)
def test_no_symbols_where_there_are_none(drive):
    assert symbol_spacing(drive) is None


@pytest.fixture
def remarks(tmp_path):
    """Return a function from a drive per frame to what is said of it."""

    def of(drive, *, sequence=None, hold=None, **split):
        path = tmp_path / "simulation.h5"
        values = np.asarray(drive, dtype=float).reshape(len(drive), -1)
        with TrajectoryWriter(path, provenance=Provenance("test"), overwrite=True) as writer:
            writer.declare_channel("sensor", ["s"], unit="V")
            writer.declare_input(
                "drive", [f"u{c}" for c in range(values.shape[1])], quantity="voltage", unit="V",
                sequence=sequence, hold=hold,
            )  # fmt: skip
            writer.append(
                np.arange(len(values)) * 0.01,
                channels={"sensor": np.zeros((len(values), 1))},
                inputs={"drive": values},
            )
        with StateLoader(path) as loader:
            return list(split_remarks(loader, Split(**split).resolve(loader)))

    return of


def test_a_held_drive_without_symbols(remarks, symbols):
    (remark,) = remarks(np.repeat(symbols[:90], 33))
    assert remark.startswith("frame clock; drive autocorrelation 0.9")
    assert "nearly memoryless, and memory capacities are inflated" in remark
    assert (
        "the drive changes every 33 frames: attach its symbols with `openprc attach-input`, or "
        "say frames_per_row=33" in remark
    )


def test_taking_the_advice_silences_the_remark(remarks, symbols):
    held = np.repeat(symbols[:90], 33)
    assert remarks(held, clock="frames", frames_per_row=33) == []
    assert remarks(held, sequence=symbols[:90, None], hold=0.33) == []


def test_a_splined_drive_without_symbols(remarks, symbols):
    (remark,) = remarks(CubicSpline(np.arange(1600), symbols)(T / 33.4))
    assert "the drive is symbols 33.4 frames apart, joined by cubics: attach its symbols" in remark
    assert "frames_per_row" not in remark


def test_a_smooth_drive_has_no_symbols(remarks):
    (remark,) = remarks(np.sin(2 * np.pi * T / 400))
    assert "no symbols are recognised in it; it decorrelates after about 10" in remark


def test_frames_in_spite_of_symbols(remarks, symbols):
    held = np.repeat(symbols[:90], 33)
    (remark,) = remarks(held, sequence=symbols[:90, None], hold=0.33, clock="frames")
    assert 'the file stores its symbols: leave clock at "auto"' in remark


def test_a_white_drive_per_frame_is_not_remarked(remarks, symbols):
    assert remarks(symbols) == []


def test_symbols_that_are_not_independent(remarks, symbols):
    smooth = np.convolve(symbols[:310], np.ones(11), mode="valid")
    (remark,) = remarks(np.repeat(smooth, 5), sequence=smooth[:, None], hold=0.05)
    assert remark.startswith("the symbols of 'drive' are not independent, autocorrelation 0.9")
    assert "capacities also count what the drive itself remembers" in remark


def test_a_drive_that_stands_still_is_not_tested(remarks):
    assert remarks(np.ones(200)) == []
