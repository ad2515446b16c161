"""Laws of the loop's statistics."""

from __future__ import annotations

import numpy as np
import pytest

from preshape.control.timing import LoopTiming


def test_an_overrun_is_lateness_plus_compute_beyond_the_period() -> None:
    timing = LoopTiming(1000)
    for lateness, compute in ((0, 1000), (400, 601), (1001, 0), (0, 0)):
        timing.add(lateness, compute)
    assert timing.report().overruns == 2 and timing.report().ticks == 4


def test_percentiles_are_those_of_the_last_ticks_and_maxima_those_of_all() -> None:
    rng = np.random.default_rng(0)
    values = rng.integers(0, 10**6, 500)
    timing = LoopTiming(2_000_000, capacity=200)
    timing.add(7_000_000, 9_000_000)
    for value in values:
        timing.add(int(value), int(value) // 2)
    report = timing.report()
    kept = values[-200:] * 1e-3
    assert report.lateness_us.p50 == pytest.approx(np.percentile(kept, 50))
    assert report.compute_us.p99 == pytest.approx(np.percentile(values[-200:] // 2, 99) * 1e-3)
    assert (report.lateness_us.max, report.compute_us.max) == (7000.0, 9000.0)


def test_a_run_without_ticks_has_a_report() -> None:
    report = LoopTiming(2_000_000).report()
    assert report.ticks == report.overruns == 0 and report.rate_hz == 500.0


@pytest.mark.parametrize(("period", "capacity"), [(0, 10), (10, 0)])
def test_sizes_that_make_no_sense_are_refused(period: int, capacity: int) -> None:
    with pytest.raises(ValueError, match="allowed is"):
        LoopTiming(period, capacity)
