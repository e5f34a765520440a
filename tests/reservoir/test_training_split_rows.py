import numpy as np
import pytest

from openprc.errors import TaskError
from openprc.reservoir.training.row_split import RowSplit


@pytest.mark.parametrize("rows", [{"washout": -1}, {"train": 0}, {"test": 1.5}, {"gap": True}])
def test_impossible_rows(rows):
    with pytest.raises(TaskError, match=f"the {next(iter(rows))} span is"):
        RowSplit(**{"washout": 1, "train": 5, "test": 5, **rows})


def test_only_measured_rows_are_used():
    split = RowSplit(washout=2, train=4, test=3, gap=1)
    usable = np.ones(12, dtype=bool)
    usable[[0, 3, 8]] = False
    train, test = split.masks(usable)
    assert train.tolist() == [2, 4, 5]
    assert test.tolist() == [7, 9]
    assert split.n_rows == 10


@pytest.mark.parametrize(("lost", "name"), [(slice(2, 6), "training"), (slice(7, 10), "test")])
def test_no_measured_row_in_a_span(lost, name):
    usable = np.ones(12, dtype=bool)
    usable[lost] = False
    with pytest.raises(TaskError, match=f"none of the . {name} rows was measured"):
        RowSplit(washout=2, train=4, test=3, gap=1).masks(usable)
