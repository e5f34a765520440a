"""Workspaces that people changed: a valid trajectory, or an error that says what is wrong."""

from __future__ import annotations

import copy

import numpy as np
import pytest
from openprc_merlin import samples

from openprc.errors import OpenPRCError
from openprc.hooks import import_file


def _leaves(variables, path=()):
    for name, value in variables.items():
        if isinstance(value, dict):
            yield from _leaves(value, (*path, name))
        yield (*path, name)


def _swapped(value, rng):
    """Return another value of the kind that other programs and tired users leave behind."""
    array = np.asarray(value) if not isinstance(value, dict | str) else np.zeros((2, 2))
    numeric = array if array.dtype.kind in "fiu" else np.ones((2, 3))
    choices = [
        lambda: numeric.T,
        lambda: numeric.astype("u1"),
        lambda: numeric.astype("i2"),
        lambda: numeric.astype("f4"),
        lambda: numeric.astype(np.complex128) + (1j if rng.random() < 0.5 else 1e-14j),
        lambda: numeric * np.nan,
        lambda: np.where(rng.random(numeric.shape) < 0.1, np.inf, numeric),
        lambda: numeric[:-1] if len(numeric) else numeric,
        lambda: np.vstack([numeric, numeric]) if numeric.ndim == 2 else numeric,
        lambda: numeric.ravel(),
        lambda: numeric - 1,
        lambda: numeric + 0.5,
        lambda: numeric * 1e80,
        lambda: np.zeros((0, 0)),
        lambda: np.zeros((0, 4)),
        lambda: np.zeros((3, 2, 4)),
        lambda: 7.0,
        lambda: "text",
        lambda: "@(x)Ogden(x,a)",
        lambda: np.array([["a", 1.0]], dtype=object),
        lambda: {"Node": numeric},
        lambda: numeric > 0,
    ]
    with np.errstate(invalid="ignore", over="ignore"):
        return choices[int(rng.integers(len(choices)))]()


@pytest.mark.parametrize("seed", range(2))
def test_changed_workspaces_are_read_or_named(mat, tmp_path, seed):
    rng = np.random.default_rng(seed)
    outcomes = set()
    for _ in range(25):
        variables = copy.deepcopy(samples.workspace(12))
        paths = list(_leaves(variables))
        for _ in range(int(rng.integers(1, 4))):
            path = paths[int(rng.integers(len(paths)))]
            owner = variables
            for name in path[:-1]:
                owner = owner.get(name, {}) if isinstance(owner, dict) else {}
            if not isinstance(owner, dict) or path[-1] not in owner:
                continue
            if rng.random() < 0.15:
                del owner[path[-1]]
            else:
                owner[path[-1]] = _swapped(owner[path[-1]], rng)
        file = mat(variables, name="changed.mat")
        options = {"verify": "true", "stored": "true"}
        try:
            # The host validates the result, and names a fault of the plugin as one.
            import_file(
                file, tmp_path / "out.h5", as_name="merlin", options=options, overwrite=True
            )
            outcomes.add("read")
        except OpenPRCError as error:
            outcomes.add(type(error).__name__)
    assert "PluginError" not in outcomes
    assert {"read", "SchemaError"} <= outcomes


def test_hinges_beside_no_bars(mat, load, space):
    """A body of panels alone: the crease lengths are those of the rest shape."""
    space["truss"]["Bars"] = np.zeros((0, 2))
    space["truss"]["L"] = np.zeros((0, 1))
    space["truss"]["A"] = np.zeros((0, 1))
    trajectory = load(mat(space)).trajectory
    assert trajectory.element_kinds == ("faces", "hinges")
    assert trajectory.element_static("hinges", "crease_length").tolist() == [2.0]


@pytest.mark.parametrize("transposed", [False, True])
def test_v73_with_small_integers_and_transposed_history(
    tmp_path, load, mat, space, write_v73, transposed
):
    """What packs whole numbers, and what is turned by hand, is the same run in either container."""
    plain = load(mat(space)).trajectory
    for name in ("Bars", "Trigl", "FixedDofs"):
        space["truss"][name] = space["truss"][name].astype("u1")
    space["angles"]["fold"] = space["angles"]["fold"].astype("u1")
    space["Uhis"] = space["Uhis"] + 1e-17j
    if transposed:
        space["Uhis"] = space["Uhis"].T
    write_v73(tmp_path / "v73.mat", space)
    found = load(tmp_path / "v73.mat").trajectory
    np.testing.assert_array_equal(found.positions(), plain.positions())
    for kind in ("bars", "hinges", "faces"):
        np.testing.assert_array_equal(found.indices(kind), plain.indices(kind))
