"""How the loop keeps its time: lateness and compute of every tick, kept without allocating."""

from __future__ import annotations

import gc
from collections.abc import Generator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Percentiles:
    """A distribution in microseconds."""

    p50: float = 0.0
    p99: float = 0.0
    p99_9: float = 0.0
    max: float = 0.0


@dataclass(frozen=True, slots=True)
class TimingReport:
    """What the loop's time looked like. An overrun is a tick whose lateness + compute exceeds the period."""

    rate_hz: float
    ticks: int
    overruns: int
    compute_us: Percentiles
    lateness_us: Percentiles


class LoopTiming:
    """A ring of the last `capacity` ticks; counts and maxima are over all of them."""

    def __init__(self, period_ns: int, capacity: int = 1 << 17) -> None:
        if period_ns < 1 or capacity < 1:
            raise ValueError(f"period_ns, capacity: got {period_ns}, {capacity}, allowed is >= 1")
        self._period_ns = period_ns
        self._lateness: NDArray[np.int64] = np.zeros(capacity, dtype=np.int64)
        self._compute: NDArray[np.int64] = np.zeros(capacity, dtype=np.int64)
        self._worst_lateness = self._worst_compute = 0
        self.ticks = self.overruns = 0

    def add(self, lateness_ns: int, compute_ns: int) -> None:
        """Take note of one tick."""
        slot = self.ticks % len(self._lateness)
        self._lateness[slot], self._compute[slot] = lateness_ns, compute_ns
        self._worst_lateness = max(self._worst_lateness, lateness_ns)
        self._worst_compute = max(self._worst_compute, compute_ns)
        self.ticks += 1
        self.overruns += lateness_ns + compute_ns > self._period_ns

    def report(self) -> TimingReport:
        """Return counts, and percentiles over the ticks still in the ring."""
        kept = min(self.ticks, len(self._lateness))
        return TimingReport(
            rate_hz=1e9 / self._period_ns,
            ticks=self.ticks,
            overruns=self.overruns,
            compute_us=_percentiles(self._compute[:kept], self._worst_compute),
            lateness_us=_percentiles(self._lateness[:kept], self._worst_lateness),
        )


def _percentiles(values_ns: NDArray[np.int64], worst_ns: int) -> Percentiles:
    if not len(values_ns):
        return Percentiles()
    p50, p99, p99_9 = np.percentile(values_ns, [50.0, 99.0, 99.9]) * 1e-3
    return Percentiles(float(p50), float(p99), float(p99_9), worst_ns * 1e-3)


@contextmanager
def quiet_collector() -> Generator[None]:
    """Keep the garbage collector out of the loop: collect once, freeze what there is, restore afterwards."""
    enabled = gc.isenabled()
    gc.collect()
    gc.freeze()
    gc.disable()
    try:
        yield
    finally:
        gc.unfreeze()
        if enabled:
            gc.enable()
