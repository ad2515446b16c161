"""A stream to the rerun viewer, or to a file for it, fed in whole columns: row by row would cost a hundred times more.

Importing this module imports rerun, which takes most of a second: import it where a stream is begun.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr
from numpy.typing import NDArray
from rerun.blueprint import Blueprint

from preshape.tools.series import COLORS, Series

APPLICATION = "preshape"
TIMELINE = "time"


class RerunStream:
    """One recording on its way; times are in seconds from its first one."""

    def __init__(self, stream: rr.RecordingStream) -> None:
        """Send to a stream that has somewhere to go."""
        self._stream = stream
        self._start_ns: int | None = None
        self._there: dict[str, bool] = {}

    @classmethod
    def to_file(cls, path: Path, blueprint: Blueprint) -> RerunStream:
        """Write an .rrd file, laid out by a blueprint."""
        stream = rr.RecordingStream(APPLICATION)
        stream.save(str(path), default_blueprint=blueprint)
        return cls(stream)

    @classmethod
    def to_viewer(cls, url: str, blueprint: Blueprint) -> RerunStream:
        """Send to a viewer that listens at `rerun+http://HOST:PORT/proxy`."""
        stream = rr.RecordingStream(APPLICATION)
        stream.connect_grpc(url, default_blueprint=blueprint)
        return cls(stream)

    @property
    def native(self) -> rr.RecordingStream:
        """The stream itself."""
        return self._stream

    def times(self, now_ns: NDArray[np.int64]) -> rr.TimeColumn:
        """Return the time column of some moments; the first one ever is the zero."""
        if self._start_ns is None:
            self._start_ns = int(now_ns[0])
        return rr.TimeColumn(TIMELINE, duration=(now_ns - self._start_ns).astype("timedelta64[ns]"))

    def send(self, path: str, now_ns: NDArray[np.int64], columns: rr.ComponentColumnList) -> None:
        """Send columns of one entity."""
        if len(now_ns):
            rr.send_columns(path, [self.times(now_ns)], columns, recording=self._stream)

    def keep(self, path: str, *values: rr.AsComponents) -> None:
        """Send values that do not change with time."""
        rr.log(path, *values, static=True, recording=self._stream)

    def due(self, path: str, known: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Return which of an entity's next rows to draw, given where it is known (n,): there, and where it has gone."""
        before = np.concatenate([[self._there.get(path, False)], known])
        self._there[path] = bool(before[-1])
        return np.flatnonzero(known | before[:-1])

    def send_series(self, series: Series, now_ns: NDArray[np.int64]) -> None:
        """Send the lines of one plot; of moments without any value only the first: it ends the lines."""
        if series.path not in self._there:
            colors = np.take(COLORS, series.color + np.arange(len(series.names)), mode="wrap").astype(np.uint32)
            self.keep(series.path, rr.SeriesLines(names=list(series.names), colors=colors))
        rows = self.due(series.path, ~np.all(np.isnan(series.values), axis=1))
        if not len(rows):
            return
        columns = rr.Scalars.columns(scalars=series.values[rows].ravel())
        self.send(series.path, now_ns[rows], columns.partition([len(series.names)] * len(rows)))

    def send_states(self, path: str, now_ns: NDArray[np.int64], values: Sequence[str]) -> None:
        """Send changes of a state that is drawn as a bar from each to the next."""
        self.send(path, now_ns, rr.StateChange.columns(state=list(values)))

    def send_events(self, now_ns: NDArray[np.int64], texts: Sequence[str], levels: Sequence[str]) -> None:
        """Send lines of the log."""
        self.send("events", now_ns, rr.TextLog.columns(text=list(texts), level=list(levels)))

    def flush(self) -> None:
        """Hand over what has been sent so far."""
        self._stream.flush()

    def close(self) -> None:
        """Hand over what is left and end the stream."""
        self._stream.flush()
        self._stream.disconnect()
