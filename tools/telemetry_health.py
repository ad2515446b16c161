"""How the loop and its device keep their time: over the last second of tick records."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from preshape.hal.state import DeviceStatus
from preshape.hal.tick_record import TickRecord, text_of
from preshape.tools.telemetry_messages import Health, Spread

WINDOW_NS = 1_000_000_000
"""What the figures are over, on the loop's clock, ns."""

_TIMES = ("now_ns", "lateness_ns", "compute_ns")
_AGE, _NEW = len(_TIMES), len(_TIMES) + 1
"""Columns beside those: age of the oldest sample, ns, and whether every joint has a newer one than a tick before."""


class HealthMeter:
    """Takes tick records as they come and tells how loop and device are."""

    def __init__(self, period_ns: int, wall_offset_ns: int = 0) -> None:
        """Judge ticks by the loop's period."""
        self._period_ns, self.wall_offset_ns = period_ns, wall_offset_ns
        self._times: NDArray[np.int64] = np.zeros((0, _NEW + 1), np.int64)
        self._last: TickRecord | None = None
        self._count = self._samples = self._overruns = 0
        self._stamp_ns = -1

    def see(self, records: TickRecord) -> None:
        """Take note of records (n,), oldest first."""
        if not len(records):
            return
        stamp_ns = records["stamp_ns"].min(axis=1)
        newer = np.diff(stamp_ns, prepend=self._stamp_ns) > 0
        self._stamp_ns = int(stamp_ns[-1])
        new = np.stack([*(records[name] for name in _TIMES), records["now_ns"] - stamp_ns, newer], axis=1)
        times = np.concatenate([self._times, new])
        self._times = times[times[:, 0] > times[-1, 0] - WINDOW_NS]
        self._overruns += int((new[:, 1] + new[:, 2] > self._period_ns).sum())
        self._count += len(records)
        self._samples += int(newer.sum())
        self._last = records[-1]

    def loop(self, seq: int) -> Health | None:
        """Return how the loop is; None before the first record."""
        if self._last is None:
            return None
        return Health(
            **self._stamped(self._last, seq),
            device="loop",
            status=text_of(self._last, "mode"),
            fault="",
            count=self._count,
            rate_hz=self._rate_hz(len(self._times) - 1),
            jitter_us=self._jitter_us(),
            overruns=self._overruns,
            lateness_us=spread(self._times[:, 1] * 1e-3),
            compute_us=spread(self._times[:, 2] * 1e-3),
        )

    def device(self, name: str, seq: int) -> Health | None:
        """Return how the device is; None before the first record."""
        if self._last is None:
            return None
        return Health(
            **self._stamped(self._last, seq),
            device=name,
            status=DeviceStatus(int(self._last["status"])).name,
            fault=text_of(self._last, "fault"),
            count=self._samples,
            rate_hz=self._rate_hz(int(self._times[1:, _NEW].sum())),
            age_ms=spread(self._times[:, _AGE] * 1e-6),
        )

    def _stamped(self, record: TickRecord, seq: int) -> dict[str, Any]:
        now_ns = int(record["now_ns"])
        return {"seq": seq, "stamp_ns": now_ns + self.wall_offset_ns, "mono_ns": now_ns}

    def _rate_hz(self, count: int) -> float:
        """Return how often something happens that has happened so many times since the first tick of the window."""
        spans_ns = int(self._times[-1, 0] - self._times[0, 0])
        return count * 1e9 / spans_ns if spans_ns > 0 else 0.0

    def _jitter_us(self) -> Spread:
        gaps = np.diff(self._times[:, 0])
        return spread(np.abs(gaps - np.median(gaps)) * 1e-3) if len(gaps) else Spread(p50=0.0, p99=0.0, max=0.0)


def spread(values: NDArray[np.floating[Any]]) -> Spread:
    """Return median, 99th percentile and maximum of at least one value."""
    p50, p99, most = np.percentile(values, [50.0, 99.0, 100.0])
    return Spread(p50=float(p50), p99=float(p99), max=float(most))
