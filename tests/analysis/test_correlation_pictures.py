"""Pictures say what they show, and nothing is drawn that is not there."""

import sys

import numpy as np
import pytest

from openprc.analysis.correlation import Linear, Nonparametric, Redundancy
from openprc.errors import MissingDependency, TaskError


def recording(n_channels, *, n_rows=300):
    rng = np.random.default_rng(9)
    u = rng.normal(size=n_rows)
    X = np.stack([np.roll(u, k) + rng.normal(size=n_rows) for k in range(n_channels)], axis=1)
    X[:, 1] = 2.0
    return u, X, [f"node{k}.z" for k in range(n_channels)]


@pytest.fixture
def lin():
    u, X, names = recording(5)
    return Linear(u, X, names=names, max_lag=40, dt=0.01)


def labels(axes):
    return [text.get_text() for text in axes.get_xticklabels()]


def legend(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_bars(lin, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    plot = lin.pearson.plot()
    axes = plot.figure.axes[0]
    assert axes.get_ylabel() == "Pearson r"
    assert labels(axes) == list(lin.pearson.names)
    heights = {round(bar.get_x() + bar.get_width() / 2): bar.get_height() for bar in axes.patches}
    assert sorted(heights) == [0, 2, 3, 4]
    assert heights[0] == lin.pearson.values[0]
    assert set(legend(plot.figure)) == {
        "significant (FDR 0.05)",
        "not significant",
        "constant",
        "p = 0.05, one channel",
    }
    assert plot.save().name == "pearson_bar.png"
    assert (tmp_path / "pearson_bar.png").stat().st_size > 5000


def test_bars_of_peaks_tell_the_lags(lin):
    axes = lin.peak.plot().figure.axes[0]
    assert [text.get_text() for text in axes.texts] == ["+0", "+2", "+3", "+4"]
    assert axes.get_title("left") == "numbers: lag [rows]"


def test_no_surrogates_are_drawn_for_a_picture(monkeypatch):
    u, X, names = recording(4)
    free = Nonparametric(u, X, names=names)
    bare = free.dcor.plot()
    assert "p_values" not in vars(free.dcor)
    assert legend(bare.figure) == ["constant"]
    marked = free.dcor.plot(alpha=0.1)
    assert "significant (FDR 0.1)" in legend(marked.figure)


def test_lines_of_few_channels(lin):
    plot = lin.ccf.plot(kind="lag_profile")
    axes = plot.figure.axes[0]
    assert axes.get_xlabel() == "lag of the channel behind the input [s]"
    peaks = [line for line in axes.lines if line.get_marker() == "o"]
    assert [line.get_xdata()[0] for line in peaks] == pytest.approx([0.0, 0.02, 0.03, 0.04])
    assert "node3.z: +0.03" in legend(plot.figure)
    # Nothing happens further away than 20 rows.
    assert axes.get_xlim() == pytest.approx((-0.2, 0.2))


def test_an_image_of_many_channels():
    u, X, names = recording(12)
    result = Linear(u, X, names=names, max_lag=40).ccf
    axes, bar = result.plot().figure.axes
    assert axes.get_xlabel() == "lag of the channel behind the input [rows]"
    assert bar.get_ylabel() == "cross-correlation"
    assert [text.get_text() for text in axes.get_yticklabels()] == names
    circles = {line.get_ydata()[0]: line.get_xdata()[0] for line in axes.lines[:-1]}
    assert circles == {k: k for k in range(12) if k != 1}
    assert axes.get_title("left").endswith("grey: constant")
    (image,) = axes.images
    assert image.get_array().shape == (12, 41)
    assert result.plot("heatmap").default_path.name == "ccf_heatmap.png"


def test_a_profile_in_which_nothing_happens_is_drawn_whole():
    rng = np.random.default_rng(10)
    figure = Linear(*rng.normal(size=(2, 400)), max_lag=60).ccf.plot().figure
    assert figure.axes[0].get_xlim() == (-60, 60)
    assert legend(figure) == ["x0: none", "p = 0.05, one lag"]


def test_a_matrix(lin):
    axes, bar = lin.partial.plot().figure.axes
    assert bar.get_ylabel() == "partial correlation"
    assert bar.get_ylim() == (-1, 1)
    assert labels(axes) == list(lin.partial.names)
    struck = {(int(x), int(y)) for x, y in zip(*axes.lines[0].get_data(), strict=True)}
    expected = np.argwhere(~lin.partial.significant() & np.isfinite(lin.partial.values))
    assert struck == {(int(j), int(i)) for i, j in expected if i != j}


def test_names_are_thinned():
    u, X, names = recording(150)
    shown = labels(Linear(u, X, names=names).pearson.plot().figure.axes[0])
    assert shown == names[::3]


def test_the_tree():
    u, X, names = recording(4)
    X = np.column_stack([X, X[:, 0] + 0.01 * u])
    plot = Redundancy(X, names=[*names, "copy"]).dendrogram(0.9)
    axes = plot.figure.axes[0]
    assert axes.get_title("left") == "4 channels, 3 groups at |r| ≥ 0.9 (dashed)"
    colors = {text.get_text(): text.get_color() for text in axes.get_yticklabels()}
    assert sorted(colors) == ["copy", "node0.z", "node2.z", "node3.z"]
    assert colors["copy"] == colors["node0.z"] != colors["node2.z"] == "black"
    assert plot.default_path.name == "dendrogram.png"


@pytest.mark.parametrize(
    ("metric", "kind", "suits"),
    [
        ("pearson", "heatmap", "bar"),
        ("partial", "bar", "heatmap"),
        ("ccf", "bar", "lag_profile or heatmap"),
    ],
)
def test_pictures_that_do_not_fit(lin, metric, kind, suits):
    words = rf"{metric} with values of shape .* cannot be drawn as '{kind}'\n  expected: {suits}"
    with pytest.raises(TaskError, match=words):
        getattr(lin, metric).plot(kind=kind)


def test_without_matplotlib(lin, monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(MissingDependency, match="pip install matplotlib"):
        lin.pearson.plot()


def test_a_diagnosis_of_a_stored_run(make_run, capsys):
    from openprc.analysis import correlation as corr
    from openprc.reservoir.features.node_features import NodePositions
    from openprc.reservoir.io.state_loader import StateLoader

    loader = StateLoader(make_run())
    Y = NodePositions(dims=[2]).transform(loader)
    x = loader.get_actuation_signal(actuator_idx=0, dof=2)

    lin = corr.Linear(x, Y, lag_sweep=True)
    lin.pearson.plot()
    lin.ccf.plot(kind="lag_profile")
    lin.partial.plot()
    lin.cca()
    corr.Nonparametric(x, Y).dcor.plot()
    red = corr.Redundancy(Y)
    print(f"Effective rank:  {red.rank:.1f} / {Y.shape[1]}")
    print(f"Condition number: {red.condition:.2e}")
    for g in red.groups_named(threshold=0.85):
        if len(g) > 1:
            print(f"  Redundant cluster: {g}")

    said = capsys.readouterr().out.splitlines()
    assert said[0].startswith("Effective rank:  ")
    assert said[1].startswith("Condition number: ")
    # Node 0 stands still.
    assert lin.dropped == ("x0",)
    assert red.dropped == ("y0",)
    # The network remembers linearly what it was given some symbols ago.
    assert lin.cca().values[0] > 0.9
    assert lin.cca().significant().all()
