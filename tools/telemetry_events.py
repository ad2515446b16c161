"""What happens once in a run: found by comparing each tick record with the one before."""

from __future__ import annotations

from preshape.hal.state import DeviceStatus
from preshape.hal.tick_record import TickRecord, text_of
from preshape.tools.telemetry_messages import Event, EventKind, Severity
from preshape.tools.telemetry_states import TASK_NAMES

_WATCHED = ("stop_reason", "mode", "task", "phase", "status", "fault")


class EventFinder:
    """Numbers and dates all events of a run; what is not in the records is added by `note`."""

    def __init__(self, wall_offset_ns: int = 0) -> None:
        """Start before the first record; `wall_offset_ns` is what the loop's clock lacks to Unix time."""
        self.wall_offset_ns = wall_offset_ns
        self._before: dict[str, object] = {}
        self._count = self._now_ns = self._tick = self._task = 0

    def see(self, record: TickRecord) -> list[Event]:
        """Return what has changed with this record; with the first one, how things are."""
        self._now_ns, self._tick, self._task = int(record["now_ns"]), int(record["tick"]), int(record["task"])
        now = {name: record[name].item() for name in _WATCHED}
        if now == self._before:
            return []
        before, self._before = self._before, now
        return [self._changed(name, record) for name in _WATCHED if now[name] != before.get(name) and now[name] != b""]

    def note(self, kind: EventKind, severity: Severity, text: str) -> Event:
        """Return an event that is not in the records, dated by the last of them."""
        event = Event(
            seq=self._count,
            stamp_ns=self._now_ns + self.wall_offset_ns,
            mono_ns=self._now_ns,
            tick=self._tick,
            kind=kind,
            severity=severity,
            text=text,
            task=self._task,
        )
        self._count += 1
        return event

    def _changed(self, name: str, record: TickRecord) -> Event:
        match name:
            case "stop_reason":
                return self.note("stop", "warning", text_of(record, "stop_reason"))
            case "mode":
                mode = text_of(record, "mode")
                return self.note("mode", "warning" if mode in ("stopping", "stopped") else "info", f"loop is {mode}")
            case "task":
                return self.note("task", "info", TASK_NAMES.get(self._task, "no task"))
            case "phase":
                return self.note("phase", "info", text_of(record, "phase"))
            case "status":
                status = DeviceStatus(int(record["status"]))
                severity = "error" if status is DeviceStatus.FAULT else "info"
                return self.note("mode", severity, f"device is {status.name}")
            case _:
                return self.note("fault", "error", text_of(record, "fault"))
