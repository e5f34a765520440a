"""What a script commanded becomes the input of the file, at the frame from which it acts."""

from __future__ import annotations

import numpy as np
import pytest

from openprc.errors import ConfigError
from openprc.hooks import record_run


@pytest.fixture
def ball(world):
    """A free ball at 10 Hz and without gravity."""
    p, start = world
    client = start(gravity=0.0, dt=0.1)
    body = p.createMultiBody(1.0, physicsClientId=client)
    p.changeDynamics(body, -1, linearDamping=0, physicsClientId=client)
    return p, client, body


@pytest.fixture
def record(ball, tmp_path, recorded):
    """Record some steps, given `commands` of each, and return the file."""

    def run(steps, commands=lambda step: {}, *, by_step=True, **options):
        p, client, _ = ball
        with record_run(client, tmp_path / "run.h5", producer="pybullet", **options) as session:
            for step in range(steps):
                if by_step:
                    session.step(**commands(step))
                else:
                    p.stepSimulation(physicsClientId=client)
                    session.record(**commands(step))
        return recorded()

    return run


def test_a_command_stands_at_the_frame_from_which_it_acts(ball, tmp_path, recorded):
    p, client, body = ball
    signals = {"force": {"unit": "N", "quantity": "force", "targets": "body0.link0"}}
    with record_run(client, tmp_path / "run.h5", producer="pybullet", signals=signals) as session:
        for step in range(5):
            force = float(step == 2)
            p.applyExternalForce(
                body, -1, (force, 0, 0), (0, 0, 0), p.WORLD_FRAME, physicsClientId=client
            )
            session.step(force=force)
    run = recorded()
    drive = run.input("force")
    assert (drive.unit, drive.quantity, drive.targets) == ("N", "force", ("body0.link0",))
    assert drive.value[:, 0].tolist() == [0, 0, 1, 0, 0, 0]
    # dv of frame n + 1 is force of frame n over mass: the push of frame 2 is felt in frame 3.
    speed = run.velocities()[:, 0, 0]
    assert np.diff(speed) == pytest.approx(0.1 * drive.value[:-1, 0])
    assert list(run.provenance["notes"])[-1].startswith("the input of the last frame is that of")


@pytest.mark.parametrize("by_step", [True, False])
def test_step_and_record_agree_on_the_frame(record, by_step):
    run = record(3, lambda step: {"u": 10 + step}, by_step=by_step)
    assert run.input("u").value[:, 0].tolist() == [10, 11, 12, 12]
    assert run.input("u").unit == "arb"
    assert any("unit of the input u was not told" in note for note in run.provenance["notes"])


def test_functions_arrays_and_symbols(record):
    asked = []

    def present():
        asked.append(len(asked))
        return asked[-1]

    run = record(
        4,
        signals={
            "asked": present,
            "sine": lambda t: np.sin(t),
            "ufunc": np.cos,
            "rows": {"value": np.arange(8.0).reshape(4, 2), "columns": ("left", "right")},
            "longer": np.arange(9.0),
            "symbols": {"sequence": [0.5, 0.25], "hold": 0.2, "unit": "V", "quantity": "voltage"},
        },
    )
    time = run.time
    assert run.input("asked").value[:, 0].tolist() == [0, 1, 2, 3, 3]
    assert asked == [0, 1, 2, 3]
    assert np.array_equal(run.input("sine").value[:, 0], np.sin(time))
    assert np.array_equal(run.input("ufunc").value[:, 0], np.cos(time))
    assert run.input("rows").columns == ("left", "right")
    assert run.input("rows").value.tolist() == [[0, 1], [2, 3], [4, 5], [6, 7], [6, 7]]
    assert run.input("longer").value[:, 0].tolist() == [0, 1, 2, 3, 4]
    symbols = run.input("symbols")
    assert symbols.value[:, 0].tolist() == [0.5, 0.5, 0.25, 0.25, 0.25]
    assert symbols.sequence.tolist() == [[0.5], [0.25]]
    assert (symbols.hold, symbols.start, symbols.unit) == (0.2, 0.0, "V")


def test_symbols_beside_the_values_that_were_made_of_them(record):
    run = record(
        4,
        lambda step: {"u": 2.0 * step},
        signals={"u": {"value": "given", "sequence": [1.0, 2.0], "hold": 0.2}},
    )
    assert run.input("u").value[:, 0].tolist() == [0, 2, 4, 6, 6]
    assert run.input("u").sequence.tolist() == [[1.0], [2.0]]


def test_signals_over_many_blocks(record):
    run = record(3000, lambda step: {"u": float(step), "v": (step, -step)})
    assert run.input("u").value[:, 0].tolist() == [*range(3000), 2999]
    assert run.input("v").value[:-1, 1].tolist() == [-step for step in range(3000)]
    assert run.input("v").columns == ("v0", "v1")


def test_a_run_without_steps_has_the_input_of_its_start(record):
    run = record(0, signals={"u": lambda t: 3.0 + t})
    assert run.input("u").value.tolist() == [[3.0]]


@pytest.mark.parametrize(("signals", "words"), [
    ({"u": {"units": "N"}}, "has no 'units'"),
    ({"u": {"sequence": [1.0]}}, "names one of sequence and hold"),
    ({"u": {"sequence": [1.0], "hold": 0.0}}, "hold 0.0, start 0.0"),
    ({"u": "torque"}, "is <U6 of shape"),
    ({"u": [1.0, np.nan]}, "holds NaN"),
    ({"u": 3.0}, "is float64 of shape \\(\\)"),
])  # fmt: skip
def test_signals_that_make_no_sense(record, signals, words):
    with pytest.raises(ConfigError, match=words):
        record(1, signals=signals)


@pytest.mark.parametrize(("signals", "commands", "words"), [
    ({"u": {}}, lambda step: {}, "'u' was not given with this step"),
    ({"u": {}}, lambda step: {"u": np.inf}, "'u' is inf"),
    ({"u": {}}, lambda step: {"u": "x"}, "'u' is 'x'"),
    ({"u": {}}, lambda step: {"u": [1.0] * (1 + step)}, "has 2 values at 0.1 s"),
    ({}, lambda step: {"u": 1.0} if step else {}, "'u' was given with this step, and is no"),
    ({}, lambda step: {"v": 1.0} if step else {"u": 1.0}, "'u' was not given"),
    ({"u": lambda: None}, lambda step: {}, "'u' is None"),
    ({"u": [1.0, 2.0]}, lambda step: {}, "has 2 rows, and step 2 begins at 0.2 s"),
    ({"u": {"sequence": [1.0], "hold": 0.1}}, lambda step: {}, "has no symbol at 0.2 s"),
    ({"u": {"columns": ("a", "b")}}, lambda step: {"u": 1.0}, "has 1 values"),
])  # fmt: skip
def test_commands_that_make_no_sense(record, signals, commands, words):
    with pytest.raises(ConfigError, match=words) as raised:
        record(4, commands, signals=signals)
    assert raised.value.fix
    assert raised.value.expected


def test_a_script_that_fails_is_not_asked_again(ball, tmp_path, recorded):
    _, client, _ = ball
    asked = []

    def of_time(t):
        asked.append(t)
        return 1.0 / (0.2 - t)  # fails at the third frame

    def script():
        with record_run(
            client, tmp_path / "run.h5", producer="pybullet", signals={"u": of_time}
        ) as session:
            for _ in range(5):
                session.step()

    with pytest.raises(ZeroDivisionError):
        script()
    assert asked == [0.0, 0.1, 0.2]
    run = recorded(tmp_path / "run.h5.partial", allow_incomplete=True)
    assert run.input("u").value[:, 0] == pytest.approx([5.0, 10.0, 10.0])


def test_a_script_that_fails_before_its_first_step(ball, tmp_path):
    _, client, _ = ball

    def script():
        with record_run(client, tmp_path / "run.h5", producer="pybullet", signals={"u": {}}):
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        script()
    assert not list(tmp_path.iterdir())  # there is no frame to keep


def test_no_step_and_no_command(record):
    with pytest.raises(ConfigError, match="no step was made"):
        record(0, signals={"u": {}})
