"""Tables of results: plain values, pandas, LaTeX."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from openprc.errors import MissingDependency, TaskError

if TYPE_CHECKING:
    import pandas as pd

    from openprc.analysis.correlation.result import Result

_ESCAPES = str.maketrans(
    {
        "\\": r"\textbackslash{}",
        "&": r"\&",
        "%": r"\%",
        "$": r"\$",
        "#": r"\#",
        "_": r"\_",
        "{": r"\{",
        "}": r"\}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "<": r"$<$",
        ">": r"$>$",
        "|": r"$|$",
    }
)


def escaped(text: str) -> str:
    """Return text that LaTeX prints as it is."""
    return text.translate(_ESCAPES)


def as_dict(result: Result) -> dict[str, Any]:
    """Return plain values, NaN as None."""
    return {
        "method": result.method,
        "label": result.label,
        "names": list(result.names),
        "values": _plain(result.values),
        "p_values": _plain(result.p_values) if result.has_test else None,
        "lags": None if result.lags is None else result.lags.tolist(),
        "dt": result.dt,
        "n_effective": None if result.n_effective is None else _plain(result.n_effective),
        "dropped": list(result.dropped),
        "notes": list(result.notes),
    }


def as_dataframe(result: Result) -> pd.DataFrame:
    """Return a pandas table; see `Result.to_dataframe`."""
    try:
        import pandas as pd
    except ImportError as error:
        raise MissingDependency(
            "pandas is not installed",
            expected="pandas, which makes the table",
            fix="pip install pandas, or use to_dict() or to_latex()",
        ) from error
    names = list(result.names)
    if result.is_profile:
        lags = pd.Index(result.lags, name="lag")
        return pd.DataFrame(result.values.T, index=lags, columns=names)
    index = pd.Index(names, name="channel")
    if result.is_matrix:
        return pd.DataFrame(result.values, index=index, columns=names)
    columns = {result.method: result.values}
    if result.lags is not None:
        columns["lag"] = result.lags
    if result.has_test:
        columns["p"] = result.p_values
        columns["p_fdr"] = result.corrected("fdr")
    return pd.DataFrame(columns, index=index)


def as_latex(result: Result, *, caption: str, label: str, digits: int) -> str:
    """Return a LaTeX table; see `Result.to_latex`."""
    if label and not caption:
        raise TaskError(
            f"label {label!r} without a caption",
            expected="a caption, to which LaTeX ties the label",
            fix="pass caption= as well",
            key="label",
        )
    head, body = _cells(result, digits)
    lines = [
        rf"\begin{{tabular}}{{l{'r' * (len(head) - 1)}}}",
        r"\hline",
        " & ".join(map(escaped, head)) + r" \\",
        r"\hline",
        *(" & ".join(row) + r" \\" for row in body),
        r"\hline",
        r"\end{tabular}",
    ]
    if caption:
        mark = [rf"\label{{{label}}}"] if label else []
        title = rf"\caption{{{escaped(caption)}}}"
        lines = [r"\begin{table}", r"\centering", title, *mark, *lines, r"\end{table}"]
    return "\n".join(lines) + "\n"


def _cells(result: Result, digits: int) -> tuple[list[str], list[list[str]]]:
    """Return headings, and rows of escaped cells."""

    def number(value: float) -> str:
        return "--" if np.isnan(value) else f"${value:.{digits}f}$"

    names = [escaped(name) for name in result.names]
    if result.is_matrix:
        rows = [[n, *map(number, row)] for n, row in zip(names, result.values, strict=True)]
        return ["channel", *result.names], rows
    values, lags, p = result.values, result.lags, None
    if result.is_profile and lags is not None:
        best = peak_columns(result)
        values, lags = values[np.arange(len(best)), best], lags[best]
    elif result.has_test:
        p = result.corrected("fdr")
    head, rows = (
        ["channel", result.label],
        [[n, number(v)] for n, v in zip(names, values, strict=True)],
    )
    if lags is not None:
        head.append("lag [rows]")
        for row, lag, value in zip(rows, lags, values, strict=True):
            row.append("--" if np.isnan(value) else f"${lag}$")
    if p is not None:
        head.append("p (FDR)")
        for row, q in zip(rows, p, strict=True):
            row.append("--" if np.isnan(q) else "$<0.001$" if q < 0.001 else f"${q:.3f}$")
    return head, rows


def peak_columns(result: Result) -> np.ndarray:
    """Return the column of the largest magnitude of every row; 0 for constant channels."""
    return np.argmax(np.abs(np.nan_to_num(result.values)), axis=1)


def _plain(values: np.ndarray) -> Any:
    listed = np.asarray(values, dtype=object)
    listed[np.isnan(np.asarray(values, dtype=np.float64))] = None
    return listed.tolist()
