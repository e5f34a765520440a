"""Other ways of keeping a workspace: as one struct, and panels as a matrix."""

from __future__ import annotations

import numpy as np
import pytest


@pytest.mark.parametrize("version", ["5", "7.3"])
def test_a_workspace_in_one_struct(mat, write_v73, space, load, tmp_path, version):
    direct = load(mat(space)).trajectory
    nested = {"results": space, "note": 1.0}
    if version == "5":
        path = mat(nested, "nested.mat")
    else:
        path = tmp_path / "nested.mat"
        write_v73(path, nested)
    result = load(path)
    np.testing.assert_array_equal(result.trajectory.positions(), direct.positions())
    np.testing.assert_array_equal(
        result.trajectory.element("hinges", "angle"), direct.element("hinges", "angle")
    )
    assert any("the workspace is the struct results" in note for note in result.notes)


@pytest.mark.parametrize(
    ("panels", "triangles"),
    [
        ([[1, 2, 3], [2, 4, 3]], [[0, 1, 2], [1, 3, 2]]),
        ([[1, 2, 4, 3]], [[0, 1, 3], [0, 3, 2]]),
        ([[1, 2, 3, np.nan], [2, 4, 3, np.nan]], [[0, 1, 2], [1, 3, 2]]),
    ],
)
def test_panels_in_a_matrix(mat, space, load, panels, triangles):
    """A cell of equal rows is easily saved as a matrix; each row is a panel."""
    bare = {key: space[key] for key in ("Node", "Uhis")}
    tr = load(mat({**bare, "Panel": np.array(panels, dtype=np.float64)})).trajectory
    assert tr.indices("faces").tolist() == triangles
