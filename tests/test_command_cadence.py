"""Commands that arrive unevenly are taken evenly, each at most once, and never kept for long."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from preshape.sim_backend.command_cadence import DELAY_STEPS, CommandCadence

PERIOD = 2


def taken_at(arrivals: list[int], period: int = PERIOD, delay: int = DELAY_STEPS) -> dict[int, int]:
    """Return when each command (by its number) is taken; only the newest that has arrived can be."""
    cadence, taken, newest = CommandCadence(period, delay), dict[int, int](), -1
    for step in range(arrivals[-1] + 3 * period):
        arrived = sum(arrival <= step for arrival in arrivals) - 1
        if cadence.takes(step, arrived > newest):
            newest = arrived
            taken[newest] = step
    return taken


@given(st.lists(st.integers(0, DELAY_STEPS), min_size=2, max_size=40), st.integers(2, 5))
def test_commands_within_the_delay_of_an_even_distance_are_taken_evenly(late: list[int], period: int) -> None:
    # The first is on time: the delay then covers those after it.
    arrivals = [10 + period * k + (jitter if k else 0) for k, jitter in enumerate(late)]
    steps = taken_at(arrivals, period)
    assert list(steps) == list(range(len(arrivals)))
    assert {b - a for a, b in pairwise(steps.values())} == {period}


@given(st.lists(st.integers(0, 1), min_size=2, max_size=40), st.integers(2, 5))
def test_without_delay_they_are_taken_evenly_from_the_latest_on(late: list[int], period: int) -> None:
    steps = taken_at([10 + period * k + jitter for k, jitter in enumerate(late)], period, delay=0)
    latest = late.index(max(late))
    assert {b - a for a, b in pairwise(list(steps.values())[latest:])} <= {period}


def test_without_delay_commands_on_time_are_taken_as_they_come() -> None:
    assert taken_at([4, 6, 8, 12], delay=0) == {0: 4, 1: 6, 2: 8, 3: 12}


@given(st.lists(st.integers(0, 9), min_size=1, max_size=60))
def test_every_command_that_is_not_overtaken_is_taken_within_a_period_and_the_delay(gaps: list[int]) -> None:
    arrivals = [sum(gaps[: k + 1]) for k in range(len(gaps))]
    steps = taken_at(arrivals)
    assert list(steps.values()) == sorted(set(steps.values()))
    for number, step in steps.items():
        assert 0 <= step - arrivals[number] <= PERIOD + DELAY_STEPS
    assert max(steps) == len(arrivals) - 1


def test_a_pause_begins_the_cadence_anew() -> None:
    assert taken_at([0, 2, 20, 22]) == {0: 1, 1: 3, 2: 21, 3: 23}


def test_nothing_is_taken_when_nothing_waits() -> None:
    cadence = CommandCadence(PERIOD)
    assert not any(cadence.takes(step, False) for step in range(20))


def test_a_period_of_no_steps_is_refused() -> None:
    with pytest.raises(ValueError, match="period_steps: got 0, allowed is >= 1"):
        CommandCadence(0)


def test_a_negative_delay_is_refused() -> None:
    with pytest.raises(ValueError, match="delay_steps: got -1, allowed is >= 0"):
        CommandCadence(PERIOD, -1)
