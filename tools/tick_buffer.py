"""An observer that keeps what a recording needs: every tick's timing, and whole records at a lower rate."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from preshape.hal.tick_record import TICK, TickRecord

TIMING = np.dtype([("now_ns", np.int64), ("lateness_ns", np.int64), ("compute_ns", np.int64)])
"""The part of a tick that is kept of every one."""


class _Rows:
    """Rows of one dtype, appended by copying into blocks."""

    def __init__(self, dtype: np.dtype[np.void], block: int) -> None:
        self._dtype, self._block = dtype, block
        self._full: list[NDArray[np.void]] = []
        self._open = np.zeros(block, dtype)
        self._used = 0

    def next_row(self) -> NDArray[np.void]:
        """Return the next row to be written, as an array without dimensions."""
        if self._used == self._block:
            self._full.append(self._open)
            self._open, self._used = np.zeros(self._block, self._dtype), 0
        self._used += 1
        return self._open[self._used - 1, ...]

    def all(self) -> NDArray[np.void]:
        """Return a copy of all rows."""
        return np.concatenate([*self._full, self._open[: self._used]])


class TickBuffer:
    """Keeps records each `interval_s` and at every change of task, phase, mode, status or fault.

    About 2.5 kB a record kept: 100 Hz take 15 MB a minute.
    """

    def __init__(self, interval_s: float = 0.01) -> None:
        """Keep a whole record each `interval_s` (s)."""
        if interval_s < 0:
            raise ValueError(f"interval_s must be >= 0, got {interval_s}")
        self._interval_ns = round(interval_s * 1e9)
        self._records, self._timing = _Rows(TICK, 1024), _Rows(TIMING, 8192)
        self._due_ns: int | None = None
        self._doing: tuple[object, ...] = ()

    def notify(self, record: TickRecord) -> None:
        """Copy what is to be kept of one tick; allocates a block now and then, never waits."""
        now_ns = int(record["now_ns"])
        row = self._timing.next_row()
        row["now_ns"], row["lateness_ns"], row["compute_ns"] = now_ns, record["lateness_ns"], record["compute_ns"]
        doing = tuple(record[name].item() for name in ("task", "phase", "mode", "status", "fault"))
        if self._due_ns is None or now_ns >= self._due_ns or doing != self._doing:
            self._records.next_row()[...] = record
            self._due_ns, self._doing = now_ns + self._interval_ns, doing

    def records(self) -> TickRecord:
        """Return the records kept, (n,) of dtype `TICK`."""
        return self._records.all()

    def timing(self) -> NDArray[np.void]:
        """Return the timing of all ticks, (n,) of dtype `TIMING`."""
        return self._timing.all()
