"""Wilson's interval: published values and the laws of a score interval."""

from math import comb, sqrt

import pytest
from hypothesis import given
from hypothesis import strategies as st

from preshape.tools.wilson import wilson

COUNTS = st.integers(1, 400).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n)))


@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"),
    # Newcombe 1998, Stat. Med. 17, 857-872, table I, method 3.
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_equals_published_values(successes: int, trials: int, low: float, high: float) -> None:
    assert wilson(successes, trials) == pytest.approx((low, high), abs=6e-5)


@given(COUNTS)
def test_bounds_are_where_the_score_test_turns(counts: tuple[int, int]) -> None:
    successes, trials = counts
    share, z = successes / trials, 1.959963984540054
    for bound in wilson(successes, trials):
        score = abs(share - bound)
        assert score == pytest.approx(z * sqrt(bound * (1 - bound) / trials), abs=1e-9)


@given(COUNTS)
def test_holds_the_share_and_stays_a_probability(counts: tuple[int, int]) -> None:
    low, high = wilson(*counts)
    assert 0.0 <= low <= counts[0] / counts[1] <= high <= 1.0
    assert low < high


@given(COUNTS)
def test_failures_mirror_successes(counts: tuple[int, int]) -> None:
    low, high = wilson(*counts)
    mirrored = wilson(counts[1] - counts[0], counts[1])
    assert (1 - mirrored.high, 1 - mirrored.low) == pytest.approx((low, high), abs=1e-12)


@given(COUNTS)
def test_more_runs_of_the_same_share_and_less_confidence_narrow_it(counts: tuple[int, int]) -> None:
    def width(successes: int, trials: int, confidence: float = 0.95) -> float:
        low, high = wilson(successes, trials, confidence)
        return high - low

    assert width(4 * counts[0], 4 * counts[1]) < width(*counts)
    assert width(*counts, 0.8) < width(*counts)


@pytest.mark.parametrize("p", [0.5, 0.8, 0.95])
def test_covers_the_truth_about_as_often_as_it_says(p: float) -> None:
    trials = 40
    covered = 0.0
    for successes in range(trials + 1):
        low, high = wilson(successes, trials)
        if low <= p <= high:
            covered += comb(trials, successes) * p**successes * (1 - p) ** (trials - successes)
    assert 0.91 < covered < 0.99


def test_without_a_trial_nothing_is_known() -> None:
    assert wilson(0, 0) == (0.0, 1.0)


@pytest.mark.parametrize("arguments", [(-1, 5), (6, 5), (1, 5, 0.0), (1, 5, 1.0)])
def test_refuses_what_is_no_count_or_confidence(arguments: tuple[int, ...]) -> None:
    with pytest.raises(ValueError, match="allowed is"):
        wilson(*arguments)
