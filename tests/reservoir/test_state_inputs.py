import numpy as np
import pytest

from openprc.errors import MissingInputError
from openprc.reservoir.features.input_features import Inputs
from openprc.reservoir.io.state_loader import StateLoader


@pytest.fixture
def loader(make_body):
    with StateLoader(make_body(sequence=range(8), hold=0.05)) as opened:
        yield opened


def test_all_columns_of_all_inputs(loader):
    assert loader.input_columns() == ["base.x", "base.z", "symbols.u"]
    values = loader.input_values()
    np.testing.assert_array_equal(values[:, 1], loader.get_actuation_signal("base", 2))
    np.testing.assert_array_equal(values[:, 2], np.repeat(np.arange(8.0), 5))


@pytest.mark.parametrize(
    ("which", "dof", "columns"),
    [
        (0, None, ["base.x", "base.z"]),
        ("symbols", None, ["symbols.u"]),
        ([1, "base"], None, ["symbols.u", "base.x", "base.z"]),
        ("base", 2, ["base.z"]),
        (["base"], ["z", 0], ["base.z", "base.x"]),
    ],
)
def test_inputs_by_name_and_position(loader, which, dof, columns):
    feature = Inputs(which, dof=dof)
    assert feature.names(loader) == columns
    assert feature.transform(loader).shape == (40, len(columns))


def test_inputs_that_are_not_there(loader, make_body):
    with pytest.raises(MissingInputError, match="there is no input 'top'"):
        loader.input_values(["base", "top"])
    with pytest.raises(MissingInputError, match="no column 'u'"):
        loader.input_values(dof="u")
    path = make_body(inputs=False, name="silent.h5")
    with StateLoader(path) as silent, pytest.raises(MissingInputError, match="attach-input"):
        Inputs().transform(silent)
