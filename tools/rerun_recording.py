"""The observer that becomes `recording.rrd`: it copies during the run, and writes when the run is over."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from preshape.hal.tick_record import TickRecord
from preshape.hal.world import NominalBox, Workcell
from preshape.tools.tick_buffer import TickBuffer


class RerunRecording:
    """Keeps what happens in memory and writes one .rrd file from it.

    Writing imports rerun and takes a second or two; it is no work for a loop.
    """

    def __init__(self, workcell: Workcell, box: NominalBox, interval_s: float = 0.01) -> None:
        """Draw around the controller's own knowledge; plots have a point each `interval_s` (s)."""
        self._workcell, self._box = workcell, box
        self._buffer = TickBuffer(interval_s)

    def notify(self, record: TickRecord) -> None:
        """Take note of one tick."""
        self._buffer.notify(record)

    def records(self) -> TickRecord:
        """Return the records kept, (n,) of dtype `TICK`."""
        return self._buffer.records()

    def timing(self) -> NDArray[np.void]:
        """Return the timing of all ticks, (n,) of dtype `tick_buffer.TIMING`."""
        return self._buffer.timing()

    def write(self, path: Path | str) -> Path:
        """Write the recording and return its path; `ValueError` when nothing was recorded."""
        from preshape.tools.rerun_content import write_recording

        path = Path(path)
        path.parent.mkdir(parents=True, exist_ok=True)
        return write_recording(path, self._buffer.records(), self._buffer.timing(), self._workcell, self._box)
