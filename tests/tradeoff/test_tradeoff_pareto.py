"""The front against brute force, and costs in between."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from openprc.tradeoff.pareto import cheapest, cost_of, evaluations, pareto_front
from openprc.tradeoff.point import Point


def made(cost, error, **more):
    return Point(group="g", label="l", setting={}, cpu_seconds=cost, trajectory_error=error, **more)


numbers = st.integers(1, 6).map(float)


@given(st.lists(st.tuples(numbers, numbers), max_size=12))
def test_the_front_is_what_nothing_beats(pairs):
    points = [made(*pair) for pair in pairs]
    kept = {
        pair
        for pair in pairs
        if not any(
            (c <= pair[0] and e <= pair[1]) and (c < pair[0] or e < pair[1]) for c, e in pairs
        )
    }
    front = pareto_front(points)
    assert {(p.cpu_seconds, p.trajectory_error) for p in front} == kept
    assert len(front) == len(kept)
    costs = [p.cpu_seconds for p in front]
    assert costs == sorted(costs)


def test_points_without_a_result_are_on_no_front():
    bad = made(0.1, 0.0, status="diverged", note="blew up")
    assert pareto_front([bad, made(1.0, None), made(None, 0.1)]) == ()
    assert cheapest([bad], 1.0) is None


def test_another_cost_may_be_counted():
    a, b = made(1.0, 0.1, evaluations=100), made(2.0, 0.2, evaluations=10)
    assert pareto_front([a, b]) == (a,)
    assert pareto_front([a, b], cost=evaluations) == (b, a)


@given(st.lists(st.tuples(numbers, numbers), min_size=1, max_size=12), numbers)
def test_the_cheapest_reaches_the_target(pairs, target):
    points = [made(*pair) for pair in pairs]
    found = cheapest(points, target)
    able = [cost for cost, error in pairs if error <= target]
    assert (found is None) == (not able)
    if found is not None:
        assert found.cpu_seconds == min(able)
        assert found.trajectory_error <= target


@pytest.mark.parametrize("order", [1, 2, 4])
def test_costs_in_between_follow_the_power_law(order):
    ladder = [made(2.0**k, 2.0 ** (-order * k)) for k in range(6)]
    target = 2.0 ** (-order * 2.5)
    assert cost_of(ladder, target) == pytest.approx(2.0**2.5)


def test_a_first_rung_that_is_good_enough_costs_what_it_costs():
    ladder = [made(3.0, None, status="diverged"), made(4.0, 1e-6), made(8.0, 1e-9)]
    assert cost_of(ladder, 1e-2) == 4.0
    assert cost_of(ladder, 1e-12) is None
