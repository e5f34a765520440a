"""`simulation.accuracy` in config.json: what may be left out with it, and what is refused."""

from __future__ import annotations

import copy
import json
from dataclasses import replace

import pytest

from openprc.errors import ConfigError
from openprc.schema import Experiment, load_experiment, save_experiment
from openprc.schema.config import parse_config
from openprc.schema.experiment import AUTO
from openprc.schema.experiment_checks import check_experiment
from openprc.schema.geometry import Bars, Geometry

CONFIG = {
    "openprc_config": "1.0",
    "simulation": {"duration": 1.0, "save_interval": 0.1, "accuracy": 1e-4},
}


def config(**simulation):
    data = copy.deepcopy(CONFIG)
    data["simulation"] |= simulation
    return data


@pytest.fixture
def experiment():
    bars = Bars(indices=[[0, 1]], stiffness=[100.0], rest_length=[1.0])
    body = Geometry(positions=[[0, 0, 0], [1.1, 0, 0]], masses=[1, 1], fixed=[1, 0], bars=bars)
    return Experiment(geometry=body, duration=1.0, dt=0.01, save_interval=0.1)


def test_step_and_integrator_may_be_left_out():
    section = parse_config(config()).simulation
    assert (section.accuracy, section.dt, section.integrator) == (1e-4, None, None)


@pytest.mark.parametrize("accuracy", [0, 0.0, -1e-4, 1, 1.5, "1e-4", True])
def test_an_accuracy_that_is_none_is_refused(accuracy):
    with pytest.raises(ConfigError, match="accuracy") as caught:
        parse_config(config(accuracy=accuracy))
    assert "which integrator and step are chosen for" in str(caught.value)
    assert "simulation.dt" not in str(caught.value)  # one mistake, one message


def test_without_an_accuracy_a_step_is_needed():
    data = config()
    del data["simulation"]["accuracy"]
    with pytest.raises(ConfigError, match=r"simulation\.dt: the key is missing") as caught:
        parse_config(data)
    assert "time step of the integrator [s]" in str(caught.value)


def test_a_missing_step_does_not_hide_other_mistakes():
    data = config(duration="long")
    del data["simulation"]["accuracy"]
    with pytest.raises(ConfigError, match="2 mistakes") as caught:
        parse_config(data)
    assert "simulation.dt" in str(caught.value)
    assert "simulation.duration" in str(caught.value)


@pytest.mark.parametrize(
    ("stated", "dt_stated", "integrator"),
    [({}, False, AUTO), ({"dt": 0.05}, True, AUTO), ({"integrator": "verlet"}, False, "verlet")],
)
def test_what_is_left_open_survives_a_round_trip(
    experiment, tmp_path, stated, dt_stated, integrator
):
    open_ = replace(
        experiment,
        accuracy=1e-4,
        dt_stated="dt" in stated,
        dt=stated.get("dt", experiment.save_interval),
        integrator=stated.get("integrator", AUTO),
    )
    save_experiment(open_, tmp_path)
    written = json.loads((tmp_path / "input" / "config.json").read_text())["simulation"]
    assert written == {"duration": 1.0, "save_interval": 0.1, "accuracy": 1e-4} | stated
    back = load_experiment(tmp_path)
    assert (back.accuracy, back.dt_stated, back.integrator) == (1e-4, dt_stated, integrator)
    assert back.settings() == open_.settings()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"accuracy": 0.0}, r"simulation\.accuracy: 0\.0"),
        ({"accuracy": 2.0}, "above 0 and below 1"),
        ({"accuracy": float("nan")}, r"simulation\.accuracy: nan"),
        ({"integrator": AUTO}, "the integrator 'auto'"),
        ({"dt_stated": False}, "no time step"),
    ],
)
def test_an_experiment_made_in_python_is_checked_alike(experiment, changes, message):
    with pytest.raises(ConfigError, match=message):
        check_experiment(replace(experiment, **changes))
