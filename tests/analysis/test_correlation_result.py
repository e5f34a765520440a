"""Results: corrections for many tests, tables, and arrays."""

import json
import sys

import numpy as np
import pytest

from openprc.analysis.correlation import Linear, Nonparametric, Result
from openprc.errors import MissingDependency, TaskError


def result(p, **more):
    p = np.asarray(p, dtype=float)
    names = tuple(f"n_{k}" for k in range(len(p)))
    values = np.where(np.isnan(p), np.nan, 0.5)
    return Result(method="test", label="r", names=names, values=values, tested=p, **more)


def test_false_discovery_rate():
    # Benjamini and Hochberg 1995, section 3.2: four of fifteen at 5 %, three with Bonferroni.
    p = [0.0001, 0.0004, 0.0019, 0.0095, 0.0201, 0.0278, 0.0298, 0.0344, 0.0459, 0.3240]
    p += [0.4262, 0.5719, 0.6528, 0.7590, 1.0000]
    found = result(p)
    assert found.significant(0.05).sum() == 4
    assert found.significant(0.05, correction="bonferroni").sum() == 3
    assert found.significant(0.05, correction=None).sum() == 9
    assert found.corrected("bonferroni")[-1] == 1.0


@pytest.mark.parametrize("correction", ["fdr", "bonferroni", None])
def test_constant_channels_spoil_nothing(correction):
    p = [0.001, 0.03, 0.6]
    alone = result(p).corrected(correction)
    with_gap = result([np.nan, *p, np.nan])
    np.testing.assert_array_equal(with_gap.corrected(correction)[1:4], alone)
    assert np.isnan(with_gap.corrected(correction)[[0, 4]]).all()
    assert not with_gap.significant(correction=correction)[[0, 4]].any()
    assert not result([np.nan, np.nan]).significant(correction=correction).any()


def test_pairs_count_once():
    p = np.full((3, 3), np.nan)
    for (i, j), value in {(0, 1): 0.01, (0, 2): 0.02, (1, 2): 0.9}.items():
        p[i, j] = p[j, i] = value
    found = result(p).corrected("bonferroni")
    assert found[0, 1] == found[1, 0] == pytest.approx(0.03)
    assert np.isnan(np.diag(found)).all()


@pytest.mark.parametrize("alpha", [0.0, 1.0, -1])
def test_levels_out_of_range(alpha):
    with pytest.raises(TaskError, match=f"alpha is {alpha}"):
        result([0.5]).significant(alpha)


def test_corrections_that_do_not_exist():
    with pytest.raises(TaskError, match="correction is 'holm'"):
        result([0.5]).significant(correction="holm")


def test_results_are_arrays_with_names():
    found = result([0.1, 0.2])
    np.testing.assert_array_equal(np.asarray(found), [0.5, 0.5])
    assert len(found) == 2
    assert found["n_1"] == 0.5
    with pytest.raises(TaskError, match=r"there is no channel 'n_9'\n.*n_0, n_1"):
        found["n_9"]


# --- metrics are computed once, when read ------------------------------------------------------


@pytest.fixture
def arrays():
    rng = np.random.default_rng(6)
    u = rng.normal(size=200)
    X = np.stack([u + rng.normal(size=200), np.ones(200), u**2, rng.normal(size=200)], axis=1)
    return u, X, ["a_1", "clamped", "square & <b>", "noise"]


def test_metrics_are_kept(arrays):
    u, X, names = arrays
    lin, free = Linear(u, X, names=names), Nonparametric(u, X, names=names)
    for owner, metrics in (
        (lin, ("pearson", "ccf", "peak", "partial")),
        (free, ("spearman", "kendall", "dcor", "dcor_unbiased", "hsic", "hsic_profile")),
    ):
        for metric in metrics:
            found = getattr(owner, metric)
            assert getattr(owner, metric) is found
            assert found.p_values is found.p_values
            assert found.dropped == ("clamped",)
            assert np.isnan(found.values[1]).all()
            assert np.isnan(found.p_values[1]).all()
            assert np.isfinite(found.values[0]).any()
            json.dumps(found.to_dict(), allow_nan=False)
    assert repr(lin) == "Linear(4 channels, 200 rows)"
    assert repr(free) == "Nonparametric(4 channels, 200 rows, shift)"


def test_plain_values(arrays):
    u, X, names = arrays
    found = Linear(u, X, names=names).peak.to_dict()
    assert found["values"][1] is None
    assert found["p_values"][1] is None
    assert found["names"] == names
    assert found["lags"][0] == 0


def test_latex(arrays):
    u, X, names = arrays
    lin = Linear(u, X, names=names, max_lag=5)
    text = lin.peak.to_latex(caption="50 % of $x_1$", label="tab:peak")
    assert text.startswith("\\begin{table}\n\\centering\n\\caption{50 \\% of \\$x\\_1\\$}\n")
    assert "\\label{tab:peak}" in text
    lines = text.splitlines()
    assert r"channel & r at the peak lag & lag [rows] & p (FDR) \\" in lines
    assert r"clamped & -- & -- & -- \\" in lines
    (square,) = (line for line in lines if line.startswith("square"))
    assert square.startswith(r"square \& $<$b$>$ & $")
    (first,) = (line for line in lines if line.startswith(r"a\_1"))
    value = lin.peak.values[0]
    assert first == rf"a\_1 & ${value:.3f}$ & $0$ & $<0.001$ \\"
    bare = lin.ccf.to_latex(digits=2)
    assert bare.startswith("\\begin{tabular}{lrr}\n")
    assert rf"a\_1 & ${lin.ccf.values[0].max():.2f}$ & $0$ \\" in bare.splitlines()
    matrix = lin.partial.to_latex(digits=1).splitlines()
    assert matrix[0] == r"\begin{tabular}{lrrrr}"
    assert matrix[5] == r"clamped & -- & -- & -- & -- \\"
    with pytest.raises(TaskError, match="label 'tab:x' without a caption"):
        lin.pearson.to_latex(label="tab:x")


def test_tables_of_pandas(arrays, monkeypatch):
    # A stand-in: what is passed on is what counts, and pandas is optional.
    class Stand:
        @staticmethod
        def Index(values, name):
            return list(values), name

        @staticmethod
        def DataFrame(data, index=None, columns=None):
            return data, index, columns

    monkeypatch.setitem(sys.modules, "pandas", Stand)
    u, X, names = arrays
    lin = Linear(u, X, names=names, max_lag=5)
    data, index, _ = lin.peak.to_dataframe()
    assert list(data) == ["peak", "lag", "p", "p_fdr"]
    assert index == (names, "channel")
    data, index, columns = lin.ccf.to_dataframe()
    assert data.shape == (11, 4)
    assert index == (list(range(-5, 6)), "lag")
    assert columns == names
    data, index, columns = lin.partial.to_dataframe()
    assert data.shape == (4, 4)
    assert (index, columns) == ((names, "channel"), names)


def test_without_pandas(arrays, monkeypatch):
    u, X, _ = arrays
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(MissingDependency, match="pip install pandas, or use to_dict"):
        Linear(u, X).pearson.to_dataframe()
