"""``openprc tradeoff``, as it is typed."""

import json
import math

import pytest
from click.testing import CliRunner

from openprc.cli.main import main
from openprc.cli.tradeoff import command
from openprc.schema import load_experiment

QUICK = ["--integrators", "rk4", "--groups", "integrator", "--rounds", "1"]


def run(*words):
    return CliRunner().invoke(command, [str(word) for word in words])


def finite(value):
    if isinstance(value, dict):
        return all(finite(item) for item in value.values())
    if isinstance(value, list):
        return all(finite(item) for item in value)
    return not isinstance(value, float) or math.isfinite(value)


def test_a_target_gives_a_config_and_a_picture(tmp_path):
    done = run("damped-oscillator", *QUICK, "--target", "1e-4", "--out", tmp_path / "study")
    assert done.exit_code == 0, done.output
    text = " ".join(done.output.split())
    assert "the cheapest setting for an error of 0.0001" in text
    assert "verified: a run of its config" in text
    assert (tmp_path / "study" / "work_precision.png").is_file()
    chosen = load_experiment(tmp_path / "study" / "recommended")
    assert chosen.integrator == "rk4"


def test_everything_is_in_the_json(tmp_path):
    words = ["damped-oscillator", *QUICK, "--target", "1e-3", "--out", tmp_path, "--json"]
    told = json.loads(run(*words).output)
    assert finite(told)
    assert told["recommendation"]["verified_error"] <= 1e-3
    assert told["reference"]["converged"] is True
    assert told["n_measured"] == len(told["points"])
    # The same words again find everything in the folder.
    assert json.loads(run(*words).output)["n_measured"] == 0


def test_a_target_that_nothing_reaches_is_a_failure_with_a_reason():
    done = run("damped-oscillator", *QUICK, "--target", "1e-13")
    assert done.exit_code == 1
    text = " ".join(done.output.split())
    assert "no setting reaches an error of 1e-13 (trajectory): the most exact setting is" in text
    assert "what limits it: the reference is good to" in text


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["oscilator"], "did you mean 'oscillator'?"),
        (["oscillator", "--groups", "speed"], "the group 'speed'"),
        (["oscillator", "--integrators", "euler"], "the integrator 'euler'"),
        (["oscillator", "--target", "0"], "'0' is not above 0."),
        (["oscillator", "--target", "nan"], "'nan' is not a finite number."),
        (["oscillator", "-s", "mass"], "--set takes KEY=VALUE, got 'mass'"),
        (["oscillator", "--target", "1e-3", "--metric", "ipc"], "with the metric 'ipc'"),
    ],
)
def test_what_is_wrong_is_said_without_a_trace(words, message, capsys):
    with pytest.raises(SystemExit) as stop:
        main(["tradeoff", *words])
    assert stop.value.code == 2
    told = capsys.readouterr().err
    assert message in " ".join(told.split())
    assert "Traceback" not in told
