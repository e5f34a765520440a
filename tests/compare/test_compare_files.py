"""Known deviations are reported as they are: norms by node and over time, units, axes, gaps."""

import json

import numpy as np
import pytest
from compared_files import REST, compared, motion, rms, write

from openprc.compare.alignment.settings import AlignmentSettings
from openprc.compare.comparison import COLUMNS, compare_files, short_names
from openprc.errors import ConfigError, IncompleteFile, MissingData, SchemaError, UnitError
from openprc.schema import Provenance, TrajectoryWriter

T = 0.01 * np.arange(400)


@pytest.fixture
def reference(tmp_path):
    return write(tmp_path / "reference.h5", T, motion(T)[0])


def test_identical_files_differ_by_exactly_nothing(reference):
    pair = compared(reference, reference, velocities=True, elements=True)
    assert (pair.rms, pair.largest, pair.relative_rms) == (0.0, 0.0, 0.0)
    assert not pair.node_rms.any()
    assert not pair.rms_over_time.any()
    assert pair.interpolant == "none"
    assert pair.spectra.dominant_difference == 0.0
    np.testing.assert_allclose(pair.spectra.coherence[1:], 1.0)


def test_a_constant_offset_is_the_deviation_everywhere(tmp_path, reference):
    other = write(tmp_path / "other.h5", T, motion(T)[0] + [0.0, 3e-3, 4e-3])
    pair = compared(reference, other)
    np.testing.assert_allclose([pair.rms, pair.largest], 5e-3, rtol=1e-12)
    np.testing.assert_allclose(pair.node_rms, 5e-3, rtol=1e-12)
    np.testing.assert_allclose(pair.max_over_time, 5e-3, rtol=1e-12)
    assert compared(reference, other, quantity="displacements").rms < 1e-15


def test_norms_are_those_of_the_definition(tmp_path, reference):
    x = motion(T)[0]
    y = x + np.random.default_rng(1).normal(scale=1e-3, size=x.shape)
    pair = compared(reference, write(tmp_path / "other.h5", T, y), bins=40, match="index")
    apart = np.sqrt(((x - y) ** 2).sum(axis=2))
    moved = rms(x - x[0])
    np.testing.assert_allclose(pair.rms, rms(x - y), rtol=1e-12)
    np.testing.assert_allclose(pair.node_rms, np.sqrt((apart**2).mean(axis=0)), rtol=1e-12)
    np.testing.assert_allclose(pair.node_max, apart.max(axis=0), rtol=1e-12)
    frame, node = np.unravel_index(apart.argmax(), apart.shape)
    assert pair.largest_at == (str(node), T[frame])
    np.testing.assert_allclose(pair.largest, apart.max(), rtol=1e-12)
    by_bin = (apart**2).reshape(40, -1).mean(axis=1)
    np.testing.assert_allclose(pair.rms_over_time, np.sqrt(by_bin), rtol=1e-12)
    np.testing.assert_allclose(pair.max_over_time, apart.reshape(40, -1).max(axis=1), rtol=1e-12)
    np.testing.assert_allclose(pair.times, T.reshape(40, -1).mean(axis=1), rtol=1e-12)
    np.testing.assert_allclose(pair.relative_rms, rms(x - y) / moved, rtol=1e-12)
    of_frame = np.sqrt((apart**2).mean(axis=1)).max()
    np.testing.assert_allclose(pair.relative_largest_frame, of_frame / moved, rtol=1e-12)


def test_units_are_converted(tmp_path, reference):
    x = motion(T)[0]
    other = write(tmp_path / "other.h5", 1e3 * T, 1e3 * x + [1.0, 0, 0], unit="mm", time_unit="ms")
    pair = compared(reference, other)
    assert pair.unit == "m"
    np.testing.assert_allclose(pair.rms, 1e-3, rtol=1e-9)
    assert pair.interpolant == "none"


def test_pixels_are_no_metres_until_a_scale_says_so(tmp_path, reference):
    x = motion(T)[0]
    other = write(tmp_path / "other.h5", T, 500.0 * x, unit="px", frame="image")
    with pytest.raises(UnitError, match=r"(?s)in px.*in m.*length of one px in m as scale"):
        compared(reference, other)
    assert compared(reference, other, scale=2e-3, match="index").rms < 1e-15


def test_a_planar_file_shows_two_axes_of_the_other(tmp_path, reference):
    x = motion(T)[0]
    flat = write(tmp_path / "flat.h5", T, x[..., :2] + [1e-3, 0])
    for pair in (compared(reference, flat), compared(flat, reference)):
        np.testing.assert_allclose(pair.rms, 1e-3, rtol=1e-9)
    side = write(tmp_path / "side.h5", T, x[..., [0, 2]], axes="u,v")
    with pytest.raises(SchemaError, match=r"(?s)axes u, v.*has axes x, y, z.*name the two axes"):
        compared(reference, side)
    assert compared(reference, side, axes=("x", "z")).rms == 0.0
    with pytest.raises(SchemaError, match=r"(?s)axes x, w.*of those that the file has"):
        compared(reference, side, axes=("x", "w"))


def test_the_same_axes_in_another_order_are_the_same(tmp_path, reference):
    other = write(tmp_path / "other.h5", T, motion(T)[0][..., [2, 0, 1]], axes="z,x,y")
    assert compared(reference, other).rms == 0.0


def test_frames_of_reference_that_differ_are_mentioned(tmp_path, reference):
    other = write(tmp_path / "other.h5", T, motion(T)[0], frame="laboratory")
    assert any("'world' and 'laboratory'" in note for note in compared(reference, other).notes)


def test_missing_places_are_left_out_and_counted(tmp_path, reference):
    x = motion(T)[0]
    seen = np.ones(x.shape[:2], dtype="u1")
    seen[10:60, 2] = 0
    seen[0, 4] = 0
    seen[100:120, 3] = 2
    y = x + np.array([0, 0, 2e-3])
    y[100:120, 3] += 1.0
    other = write(tmp_path / "other.h5", T, y, seen=seen)
    pair = compared(reference, other)
    np.testing.assert_allclose([pair.rms, pair.largest], 2e-3, rtol=1e-9)
    assert pair.errors.n_missing == 50 + 1 + 20
    assert any("71 pairs of places (2.96%) are missing" in note for note in pair.notes)
    # The motion of the reference counts where it is compared.
    where = (seen == 1)[..., None]
    origin = np.where(np.arange(6)[:, None] == 4, x[1], x[0])
    np.testing.assert_allclose(
        pair.errors.displacement, rms(np.where(where, x - origin, np.nan)), rtol=1e-12
    )
    np.testing.assert_allclose(compared(reference, other, filled=True).largest, 3**0.5, rtol=1e-2)


def test_a_node_that_is_never_seen_has_no_figure(tmp_path, reference):
    x = motion(T)[0]
    seen = np.ones(x.shape[:2], dtype="u1")
    seen[:, 2] = 0
    pair = compared(reference, write(tmp_path / "o.h5", T, x, seen=seen), match="index")
    assert np.isnan(pair.node_rms[2])
    assert pair.rms == 0.0


def test_nothing_seen_in_both_is_an_error(tmp_path, reference):
    x = motion(T)[0]
    seen = np.zeros(x.shape[:2], dtype="u1")
    other = write(tmp_path / "other.h5", T, x, seen=seen)
    with pytest.raises(MissingData, match=r"(?s)no node is seen in both.*places that both"):
        compared(reference, other, match="index")
    with pytest.raises(MissingData, match="no node is seen at the first common instant"):
        compared(reference, other)


def test_files_without_nodes_are_refused(tmp_path, reference):
    with TrajectoryWriter(tmp_path / "c.h5", provenance=Provenance("test")) as writer:
        writer.declare_channel("gauge", ["a"], unit="V")
        writer.append(T, channels={"gauge": T[:, None]})
    with pytest.raises(MissingData, match=r"(?s)no positions.*compare files with nodes"):
        compared(reference, tmp_path / "c.h5")


def test_an_unfinished_file_is_refused(tmp_path, reference):
    writer = TrajectoryWriter(tmp_path / "cut.h5", provenance=Provenance("test"))
    writer.declare_nodes(6, 3, unit="m")
    writer.append(0.0, positions=REST)
    writer.commit()
    writer._file.close()
    with pytest.raises(IncompleteFile, match="1 frames are safe"):
        compared(reference, tmp_path / "cut.h5.partial")


def test_a_run_that_diverged_is_no_infinite_deviation(tmp_path, reference):
    x = motion(T)[0]
    x[300:] *= 1e200
    other = write(tmp_path / "other.h5", T, x)
    with pytest.raises(SchemaError, match=r"(?s)too large: their squares overflow.*smaller time"):
        compared(reference, other)
    assert compared(reference, other, stop=2.9).rms == 0.0


def test_a_body_at_rest_has_no_relative_deviation(tmp_path):
    still = np.broadcast_to(REST, (len(T), *REST.shape))
    files = [write(tmp_path / f"{k}.h5", T, still + 1e-4 * k) for k in (0, 1)]
    pair = compared(*files)
    assert pair.relative_rms is None
    assert any("does not move" in note for note in pair.notes)


def test_the_result_is_plain_and_has_a_row_for_each_file(tmp_path, reference):
    others = [write(tmp_path / f"{k}.h5", T, motion(T)[0] + 1e-3 * k) for k in (1, 2)]
    heard = []
    result = compare_files(reference, others, progress=lambda f, m: heard.append((f, m)))
    again = json.loads(json.dumps(result.as_dict()))
    assert [pair["name"] for pair in again["pairs"]] == ["1", "2"]
    assert again["reference"]["n_frames"] == len(T)
    assert all(len(row) == len(COLUMNS) for row in result.rows())
    fractions = [fraction for fraction, _ in heard]
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0


def test_one_file_is_no_comparison(reference):
    with pytest.raises(ConfigError, match="there is one file"):
        compare_files(reference, [])
    with pytest.raises(ConfigError, match="1 names for 2 files"):
        compare_files(reference, [reference], names=["a"])


def test_names_say_what_tells_paths_apart(tmp_path):
    runs = [tmp_path / name / "output" / "simulation.h5" for name in ("alpha", "beta")]
    assert short_names(runs) == ("alpha", "beta")
    assert short_names([tmp_path / "a.h5", tmp_path / "b.h5"]) == ("a", "b")
    assert short_names([tmp_path / "a.h5", tmp_path / "a.h5"]) == ("a (1)", "a (2)")


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"match": "name"}, "match is 'name'"),
        ({"interpolant": "spline"}, "interpolant is 'spline'"),
        ({"scale": -1.0}, "scale is -1.0"),
        ({"scale": "fit"}, r"(?s)scale is 'fit'.*rigid_motion"),
        ({"time_shift": np.inf}, "time_shift is inf"),
        ({"start": 2.0, "stop": 1.0}, "stop is 1.0"),
        ({"bins": 0}, "bins is 0"),
        ({"segment": 3}, "segment is 3"),
        ({"match_limit": 0.0}, "match_limit is 0.0"),
        ({"clock": "steps"}, r"(?s)clock is 'steps'.*one of auto, time"),
    ],
)
def test_settings_are_checked(settings, words):
    with pytest.raises(ConfigError, match=words):
        AlignmentSettings(**settings)
