"""Wilson's score interval: what a count of successes says about the chance behind it."""

from __future__ import annotations

from math import sqrt
from statistics import NormalDist
from typing import NamedTuple


class Interval(NamedTuple):
    """Bounds of a probability."""

    low: float
    high: float


def wilson(successes: int, trials: int, confidence: float = 0.95) -> Interval:
    """Return the interval of all p that a score test at `confidence` does not refuse.

    The bounds are the roots p of |s/n - p| = z sqrt(p (1 - p) / n), z the two-sided normal quantile:
    (s + z^2/2 +- z sqrt(s (n - s) / n + z^2/4)) / (n + z^2). Without a trial nothing is known: 0 .. 1.
    (Wilson 1927, J. Am. Stat. Assoc. 22, 209-212.)

    Raises:
        ValueError: successes not in 0 .. trials, or confidence not inside 0 .. 1.
    """
    if not 0 <= successes <= trials:
        raise ValueError(f"successes: got {successes}, allowed is 0 .. {trials} (trials)")
    if not 0.0 < confidence < 1.0:
        raise ValueError(f"confidence: got {confidence}, allowed is > 0 and < 1")
    if trials == 0:
        return Interval(0.0, 1.0)
    z = NormalDist().inv_cdf(0.5 + confidence / 2.0)
    middle = successes + z * z / 2.0
    spread = z * sqrt(successes * (trials - successes) / trials + z * z / 4.0)
    low, high = (middle - spread) / (trials + z * z), (middle + spread) / (trials + z * z)
    # At the ends rounding would leave a bound a hair off what it is exactly.
    return Interval(0.0 if successes == 0 else low, 1.0 if successes == trials else high)
