"""NARMA as a task object, and inputs that leave the recursion bounded."""

import numpy as np
import pytest

from openprc.analysis.tasks import NARMA_task, NarmaTask, bounded_input, narma_system
from openprc.errors import Diverged, TaskError


def test_the_task_is_the_function_with_horizon_one():
    u = np.random.default_rng(0).uniform(0, 0.5, 100)
    for order in (2, 5, 10, 20, 30):
        series = NarmaTask(order).target(u)
        assert series.n_warmup == order - 1
        np.testing.assert_array_equal(
            series.values[order - 1 :, 0], NARMA_task(u, order, horizon=1)[order - 1 :]
        )


@pytest.mark.parametrize(
    ("order", "escape"),
    [
        (2, (3 + np.sqrt(5)) / 4),
        (3, (0.7 + np.sqrt(0.43)) / 0.3),
        (5, (0.7 + np.sqrt(0.39)) / 0.5),
        (10, 0.7 + np.sqrt(0.29)),
        (30, 0.665414),
        (20, np.inf),
    ],
)
def test_unstable_fixed_points(order, escape):
    assert narma_system(order).escape == pytest.approx(escape, abs=1e-6)


def test_growth_is_found_before_it_is_large():
    """A constant input just above the one whose fixed point vanishes, sqrt(0.145 / 1.5)."""
    assert NARMA_task(np.full(2000, 0.31), 10).max() < 0.7
    assert NARMA_task(np.full(121, 0.32), 10).max() < 3.0
    with pytest.raises(TaskError, match=r"NARMA10 is diverging at the end of 122 .* above 1\.239"):
        NARMA_task(np.full(122, 0.32), 10)
    with pytest.raises(TaskError, match="NARMA10 diverged at step"):
        NARMA_task(np.full(200, 0.32), 10)


#: A seed whose first 10,000 symbols make order 10 diverge, as about 1 in 20 do.
DIVERGING_SEED = 4


def test_bounded_input_says_what_it_rejected():
    generator = np.random.default_rng(DIVERGING_SEED)
    with pytest.raises(TaskError, match="NARMA10 diverged at step"):
        NARMA_task(generator.uniform(0, 0.5, 10_000), 10)
    drawn = bounded_input(10_000, 10, rng=DIVERGING_SEED)
    assert (drawn.n_rejected, drawn.seed) == (1, DIVERGING_SEED)
    np.testing.assert_array_equal(drawn.input, generator.uniform(0, 0.5, 10_000))
    assert NARMA_task(drawn.input, 10).max() < 1.5
    assert bounded_input(10_000, 20, rng=DIVERGING_SEED).n_rejected == 0


def test_when_every_sequence_diverges():
    with pytest.raises(Diverged, match="NARMA10 diverged on 1 sequences of 10000 symbols"):
        bounded_input(10_000, 10, rng=DIVERGING_SEED, max_rejected=0)


def test_generated_data_can_be_made_again():
    data = NarmaTask(10).generate(300, rng=5)
    again = NarmaTask(10).generate(300, rng=data.seed)
    np.testing.assert_array_equal(data.input, again.input)
    np.testing.assert_array_equal(data.target.values, again.target.values)
    assert data.metadata["n_rejected"] == 0
    assert data.input.min() >= 0.0
    assert data.input.max() <= 0.5
    assert NarmaTask(2).generate(50, rng=np.random.default_rng(1)).seed is None


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: NarmaTask(11), "the order is 11"),
        (lambda: NarmaTask(2).target([0.9]), "runs from 0.9"),
        (lambda: bounded_input(0, 2, rng=0), "n is 0"),
        (lambda: bounded_input(5, 2, rng=None), "rng is None\n.*seed"),
        (lambda: bounded_input(5, 2, rng=-1), "rng is -1"),
        (lambda: bounded_input(5, 2, rng=0, max_rejected=-1), "max_rejected is -1"),
        (lambda: bounded_input(5, 40, rng=0), "the order is 40"),
    ],
)
def test_wrong_use(call, words):
    with pytest.raises(TaskError, match=words):
        call()


def test_range_check_can_be_left_out():
    assert NarmaTask(2, any_range=True).target([0.9, 0.1, 0.2]).values[1, 0] > 0.0
