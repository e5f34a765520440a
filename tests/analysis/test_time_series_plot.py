import numpy as np
import pytest

from openprc.analysis.visualization.time_series import TimeSeriesComparison
from openprc.errors import MissingDependency, TaskError, UnreadableFile
from openprc.schema import Provenance, results


@pytest.fixture
def readout(tmp_path):
    """Path of a readout file with 50 test rows and two outputs."""
    target = np.stack([np.sin(np.arange(50) / 5), np.cos(np.arange(50) / 5)], axis=1)
    arrays = {
        "validation/time": np.arange(50) * 0.1,
        "validation/target": target,
        "validation/prediction": target + 0.01,
        "validation/NMSE": np.array([2e-4, 2e-4]),
    }
    return results.write_result(
        tmp_path / "readout_sine.h5",
        kind="readout",
        attrs={"task_name": "sine"},
        arrays=arrays,
        provenance=Provenance("test"),
    )


def test_saved_beside_the_readout(readout):
    plot = TimeSeriesComparison().plot(readout, 10, 40)
    axes = plot.figure.axes[0]
    assert [line.get_label() for line in axes.lines] == ["target", "prediction"]
    np.testing.assert_allclose(axes.lines[0].get_xdata(), np.arange(10, 40) * 0.1)
    assert axes.get_xlabel() == "time [s]"
    path = plot.save()
    assert path == readout.with_name("readout_sine_validation.png")
    assert plot.save() == path
    assert sorted(item.name for item in readout.parent.iterdir()) == [
        "readout_sine.h5",
        "readout_sine_validation.png",
    ]


def test_end_beyond_the_last_row_is_cut(readout):
    axes = TimeSeriesComparison().plot(readout, start_frame=0, end_frame=500).figure.axes[0]
    assert len(axes.lines[0].get_xdata()) == 50


def test_other_output_and_format(readout, tmp_path):
    plot = TimeSeriesComparison().plot(readout, output=1)
    np.testing.assert_allclose(plot.figure.axes[0].lines[0].get_ydata()[0], 1.0)
    assert plot.save(tmp_path / "plot.svg").read_text().startswith("<?xml")


@pytest.mark.parametrize(
    ("keywords", "words"),
    [
        ({"start_frame": 50}, "rows 50 to None are empty"),
        ({"start_frame": 20, "end_frame": 10}, "rows 20 to 10 are empty"),
        ({"start_frame": -5}, "rows -5 to None are empty"),
        ({"span": "training"}, "no span 'training'"),
        ({"output": 2}, "output is 2"),
    ],
)
def test_nothing_to_draw(readout, keywords, words):
    with pytest.raises(TaskError, match=words):
        TimeSeriesComparison().plot(readout, **keywords)


def test_no_file(tmp_path):
    with pytest.raises(UnreadableFile):
        TimeSeriesComparison().plot(tmp_path / "none.h5")


def test_without_matplotlib(readout, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "matplotlib.figure", None)
    with pytest.raises(MissingDependency, match="pip install matplotlib"):
        TimeSeriesComparison().plot(readout)
