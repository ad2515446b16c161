"""A file for the rerun viewer, written in whole columns: one row at a time would cost a hundred times as much.

Importing this module imports rerun, which takes most of a second: import it when a recording is written.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from preshape.hal.transform import Matrix
from preshape.tools.rerun_layout import blueprint
from preshape.tools.series import COLORS, Series, changes

TIMELINE = "time"


class RerunFile:
    """One recording being written; times are in seconds from its first record."""

    def __init__(self, path: Path, start_ns: int) -> None:
        """Open the file and lay out its views."""
        self._stream = rr.RecordingStream("preshape")
        self._stream.save(str(path), default_blueprint=blueprint())
        self._start_ns = start_ns

    def times(self, now_ns: NDArray[np.int64]) -> rr.TimeColumn:
        """Return the time column of some ticks."""
        return rr.TimeColumn(TIMELINE, duration=(now_ns - self._start_ns).astype("timedelta64[ns]"))

    def send(self, path: str, now_ns: NDArray[np.int64], columns: rr.ComponentColumnList) -> None:
        """Send columns of one entity."""
        if len(now_ns):
            rr.send_columns(path, [self.times(now_ns)], columns, recording=self._stream)

    def keep(self, path: str, *values: rr.AsComponents) -> None:
        """Send values that do not change with time."""
        rr.log(path, *values, static=True, recording=self._stream)

    def add_series(self, series: Series, now_ns: NDArray[np.int64]) -> None:
        """Add the lines of one plot; ticks without any value are left out."""
        colors = np.array(COLORS[: len(series.names)], np.uint32)
        self.keep(series.path, rr.SeriesLines(names=list(series.names), colors=colors))
        known = ~np.all(np.isnan(series.values), axis=1)
        columns = rr.Scalars.columns(scalars=series.values[known].ravel())
        self.send(series.path, now_ns[known], columns.partition([len(series.names)] * int(known.sum())))

    def add_states(self, path: str, now_ns: NDArray[np.int64], values: NDArray[np.str_]) -> None:
        """Add a state that is drawn as a bar from each change to the next."""
        at = changes(values)
        self.send(path, now_ns[at], rr.StateChange.columns(state=values[at].tolist()))

    def add_events(self, now_ns: NDArray[np.int64], texts: list[str], levels: list[str]) -> None:
        """Add lines of the log."""
        self.send("events", now_ns, rr.TextLog.columns(text=texts, level=levels))

    def add_poses(self, path: str, now_ns: NDArray[np.int64], p: Matrix, R: Matrix) -> None:
        """Add poses over time: translations (n, 3), m, and rotations (n, 3, 3)."""
        self.send(path, now_ns, rr.Transform3D.columns(translation=p, mat3x3=R))

    def close(self) -> None:
        """Write what is left and close the file."""
        self._stream.flush()
        self._stream.disconnect()
