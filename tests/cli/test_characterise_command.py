import numpy as np
import pytest

from openprc.schema import Provenance, TrajectoryWriter, results


@pytest.fixture
def make_echo(tmp_path):
    """Return a function that writes 300 symbols and 8 channels that echo them, nonlinearly."""

    def make(*, sequence=True, inputs=True, binary=False):
        rng = np.random.default_rng(0)
        u = rng.choice([-1.0, 1.0], 300) if binary else rng.uniform(-1, 1, 300)
        taps = np.stack([np.roll(u, k) for k in range(4)], axis=1)
        states = np.repeat(np.hstack([taps, taps * np.roll(taps, 1, axis=1)]), 2, axis=0)
        path = tmp_path / "run.h5"
        with TrajectoryWriter(path, provenance=Provenance("test"), overwrite=True) as writer:
            writer.declare_channel("s", [f"s{k}" for k in range(8)], unit="V")
            if inputs:
                extra = {"sequence": u[:, None], "hold": 0.2} if sequence else {}
                writer.declare_input("drive", ["u"], quantity="voltage", unit="V", **extra)
            writer.append(
                np.arange(600) * 0.1,
                channels={"s": states},
                inputs={"drive": np.repeat(u, 2)[:, None]} if inputs else None,
            )
        return path

    return make


def test_tables_for_people(openprc, make_echo, tmp_path):
    outcome = openprc("characterise", make_echo(), "--networks", "1")
    assert outcome.code == 0
    for words in ("dimension of the states", "capacities", "shift register", "ESN", "narma10",
                  "300 rows (symbols, 0.2 apart)", "multiple correlation"):  # fmt: skip
        assert words in outcome.text, words
    assert [item.name for item in tmp_path.iterdir()] == ["run.h5"]


def test_numbers_for_programs(openprc, make_echo, tmp_path):
    data = openprc("characterise", make_echo(), "--networks", "0", "--json").data
    memory = data["groups"]["memory"]["metrics"]
    # Four taps and four products: the sum is the number of states.
    assert memory["rank"] == 8
    assert memory["mc_linear"] == pytest.approx(4, abs=0.05)
    # Chance adds a little to each of the targets that are orthonormal on average only.
    assert memory["ipc_total"] == pytest.approx(8, rel=0.03)
    assert (data["clock"], data["input"], data["written"]) == ("symbols", "drive/u", [])


def test_files_are_written_where_told(openprc, make_echo, tmp_path):
    out = tmp_path / "found"
    text = openprc("characterise", make_echo(), "--networks", "0", "--out", out).text
    assert results.read_result(out / "metrics" / "metrics.h5").kind == "metrics"
    assert (out / "pictures" / "memory_profile.png").is_file()
    assert "memory_profile.png" in text.replace(" ", "")


def test_a_file_without_input(openprc, make_echo):
    outcome = openprc("characterise", make_echo(inputs=False))
    assert outcome.code == 0
    assert "not measured: input_correlation, memory, kernel_quality, narma2" in outcome.text
    assert outcome.text.count("the file does not say what drove the body") == 1


def test_frames_are_warned_about(openprc, make_echo):
    text = " ".join(
        openprc("characterise", make_echo(sequence=False), "--networks", "0").text.split()
    )
    assert "frame clock; drive autocorrelation" in text
    assert "changes every 2 frames" in text


def test_figures_of_prcpy(openprc, make_echo):
    text = openprc("characterise", make_echo(), "--networks", "0", "--metrics", "prcpy").text
    assert "by the formulas of PRCpy 0.1.14" in text
    assert "non_linearity" in text


def test_any_registered_task(openprc, make_echo):
    path = make_echo(binary=True)
    data = openprc("benchmark", path, "--task", "parity", "-o", "n=2", "--json").data
    assert (data["task"], data["metric"]) == ("xor", "corr2")
    # Products of neighbours are among the channels.
    assert data["figure"] > 0.99
    data = openprc("benchmark", path, "--task", "delay-recall", "-o", "delays=[1,2]", "--json").data
    assert data["task"] == "delay1-2"
    assert data["skill"] is None


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--task", "parity", "-o", "bits=2"], "parity has no parameter 'bits'"),
        (["--task", "pariti"], "pariti"),
        (["--task", "parity"], "the input takes 300 values"),
        (["--task", "channel-equalization", "--seed", "1"], "is not the input of this task"),
        (["--task", "van-der-pol"], "close the loop"),
        (["--order", "11"], "the order is 11"),
        (["--task", "parity", "-o", "n"], "KEY=VALUE"),
    ],
)
def test_tasks_that_do_not_fit(openprc, make_echo, arguments, words):
    outcome = openprc("benchmark", make_echo(), *arguments)
    assert outcome.code == 2
    assert words in outcome.err
    assert "Traceback" not in outcome.err
