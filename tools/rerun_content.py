"""What a recording and the dashboard show of a run: plots, states, events and the scene, drawn as records come in."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from preshape.hal.answers import AnyAnswer
from preshape.hal.state import DeviceStatus
from preshape.hal.tick_record import TICK, TickRecord
from preshape.hal.world import NominalBox, Workcell
from preshape.tools.rerun_field import RerunField
from preshape.tools.rerun_robot import RerunRobot
from preshape.tools.rerun_scene import RerunScene
from preshape.tools.rerun_stream import RerunStream
from preshape.tools.series import MOST_LOOP_US, bus_series, changes, cut_off, loop_times, record_series

PLOT_INTERVAL_S = 0.02
"""Plots have a point each such time, s."""
PLOT_DELIVERY_S = 0.4
"""Plots are handed over when they have so much new, s: each delivery costs as much as many points."""
MOTION_INTERVAL_S = 0.04
"""The scene moves in steps of this interval, s."""
DOING = ("task", "phase", "mode", "status", "fault", "stop_reason")
"""Columns whose change is an event."""


def texts(column: NDArray[np.bytes_]) -> NDArray[np.str_]:
    """Return a text column of the records as strings; an empty text reads `-`."""
    decoded = np.char.decode(column, "ascii")
    return np.where(decoded == "", "-", decoded)


class Thinning:
    """Chooses one of the rows in each interval of time, over any number of blocks."""

    def __init__(self, interval_s: float) -> None:
        """Choose the first row of each `interval_s` (s)."""
        self._interval_ns, self._slot = round(interval_s * 1e9), -1

    def rows(self, now_ns: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the indices of the chosen ones among the next rows (n,)."""
        slots = now_ns // self._interval_ns
        before = np.concatenate([[self._slot], slots[:-1]])
        self._slot = int(slots[-1])
        return np.flatnonzero(slots != before)


class RerunContent:
    """Draws one run into a stream: `add_ticks` and `add_answer` as things come, `flush` a few times a second."""

    def __init__(
        self,
        stream: RerunStream,
        cell: Workcell,
        box: NominalBox,
        plot_s: float = PLOT_INTERVAL_S,
        motion_s: float = MOTION_INTERVAL_S,
        told_events: bool = False,
    ) -> None:
        """Draw around the controller's own knowledge, plots each `plot_s`, the scene each `motion_s` (s).

        With `told_events` events and the loop's times are not read from the records: they come by themselves.
        """
        self._stream = stream
        self._scene = RerunScene(stream, cell, box)
        self._field = RerunField(stream)
        self._robot = RerunRobot(stream, cell.X_world_base)
        self._pending: list[TickRecord] = []
        self._unplotted: list[TickRecord] = []
        self._plotted_ns = -(2**62)
        self._plots, self._motion = Thinning(plot_s), Thinning(motion_s)
        self._last: TickRecord | None = None
        self._told_events = told_events
        self._buses: dict[str, int] = {}

    def add_ticks(self, records: TickRecord) -> None:
        """Take the next records (n,) of dtype `TICK`."""
        if len(records):
            self._pending.append(records)

    def add_answer(self, answer: AnyAnswer, pixels: NDArray[np.uint8] | None = None) -> None:
        """Take one answer of the controller's perception."""
        self._scene.add_answer(answer, pixels)

    def add_image(self, now_ns: int, pixels: NDArray[np.uint8]) -> None:
        """Take one grey image (height, width)."""
        self._scene.add_image(np.array([now_ns]), pixels)

    def add_bus(self, now_ns: int, name: str, load: float, errors: int) -> None:
        """Take how a bus of the device is: the share of its time that is taken, and its error frames so far."""
        number = self._buses.setdefault(name, len(self._buses))
        for series in bus_series(number, name, load, errors):
            self._stream.send_series(series, np.array([now_ns]))

    def flush(self) -> None:
        """Draw what has come and hand it over."""
        if self._pending:
            records, self._pending = np.concatenate(self._pending), []
            self._draw(records)
        self._stream.flush()

    def close(self) -> None:
        """Draw what is left and end the stream."""
        self.flush()
        self._plot()
        self._stream.close()

    def _draw(self, records: TickRecord) -> None:
        if not self._told_events:
            self._stream.send_series(cut_off(loop_times(records), MOST_LOOP_US), records["now_ns"])
        self._unplotted.append(records[self._plots.rows(records["now_ns"])])
        # Either way: the clock of a new run begins anew.
        if abs(int(records["now_ns"][-1]) - self._plotted_ns) >= 1e9 * PLOT_DELIVERY_S:
            self._plot()
        self._send_progress(records)
        motion = records[self._motion.rows(records["now_ns"])]
        known = motion[~np.isnan(motion["position"][:, 0])]
        if len(known):
            self._robot.send(known["now_ns"], known["position"])
        if len(motion):
            self._scene.send(motion)
            self._field.send(motion)

    def _plot(self) -> None:
        """Send what has not been plotted yet."""
        rows = np.concatenate([np.zeros(0, TICK), *self._unplotted])
        self._unplotted = []
        if len(rows):
            self._plotted_ns = int(rows["now_ns"][-1])
            for series in record_series(rows):
                self._stream.send_series(series, rows["now_ns"])

    def _send_progress(self, records: TickRecord) -> None:
        """Send task, phase, mode and device status as states where they change, and every change as an event."""
        last = np.zeros(0, TICK) if self._last is None else self._last
        rows, skip = np.concatenate([last, records]), len(last)
        self._last = records[-1:].copy()
        status = np.array([DeviceStatus(value).name.lower() for value in rows["status"].tolist()])
        task = np.array([f"task {value}" for value in rows["task"].tolist()])
        columns = {"task": task, "phase": texts(rows["phase"]), "mode": texts(rows["mode"]), "device": status}
        for path, values in columns.items():
            at = changes(values)[skip:]
            self._stream.send_states(path, rows["now_ns"][at], values[at].tolist())
        if self._told_events:
            return
        new = {name: set(changes(rows[name])[skip:].tolist()) for name in DOING}
        at = sorted(set().union(*new.values()))
        events = [_event(rows[row], str(task[row]), str(status[row])) for row in at]
        self._stream.send_events(rows["now_ns"][at], [text for text, _ in events], [level for _, level in events])


def _event(record: TickRecord, task: str, status: str) -> tuple[str, str]:
    """Return what a record says to the log, and how grave it is."""
    phase, mode, fault, stop = (record[name].decode("ascii") for name in ("phase", "mode", "fault", "stop_reason"))
    text = f"{task}: {phase or '-'}, {mode or '-'}, device {status}"
    if fault:
        return f"{text}: {fault}", "ERROR"
    return (f"{text}: stop asked for: {stop}", "WARN") if stop else (text, "INFO")
