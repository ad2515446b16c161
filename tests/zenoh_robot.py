"""A robot for the telemetry's tests: a telemetry process fed with records, and clients that ask it."""

from __future__ import annotations

import json
import socket
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import zenoh

from preshape.control.observer import Observers
from preshape.hal import tick_record as tr
from preshape.hal.layout import LAYOUT
from preshape.hal.state import DeviceStatus, Mode, RobotCommand, RobotState
from preshape.tools.telemetry import Telemetry
from preshape.tools.telemetry_config import TelemetryConfig
from preshape.tools.zenoh_session import client_settings, open_session


def free_endpoint() -> str:
    """Return an endpoint on this machine that nobody uses."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def fill(record: tr.TickRecord, tick: int, now_ns: int) -> None:
    """Write a plausible tick into a record."""
    position = 0.1 * np.sin(0.01 * tick + np.arange(LAYOUT.dof))
    stamps = np.full(LAYOUT.dof, now_ns - 500_000)
    state = RobotState(tick, position, position, position, stamps, DeviceStatus.ARMED)
    tr.note_state(record, tick, now_ns, state)
    tr.note_command(record, RobotCommand(tick + 1, Mode.POSITION, position, LAYOUT.torque), True)
    record["task"], record["phase"], record["mode"] = 1 + tick // 500, b"approach", b"running"
    tr.note_timing(record, 60_000, 300_000)


@dataclass
class Loop:
    """Stands for the control loop: writes a tick every 2 ms in a thread, and takes note of stops."""

    telemetry: Telemetry
    stops: list[str] = field(default_factory=list)
    stop_ticks: list[int] = field(default_factory=list)
    tick: int = 0

    def request_stop(self, reason: str) -> None:
        """Take note of a stop."""
        self.stops.append(reason)
        self.stop_ticks.append(self.tick)

    def run(self, done: threading.Event) -> None:
        """Write until told to end."""
        observers, record = Observers(), tr.new_record()
        self.telemetry.watch(self, observers)  # pyright: ignore
        due = time.monotonic()
        while not done.is_set():
            due += 0.002
            time.sleep(max(0.0, due - time.monotonic()))
            fill(record, self.tick, time.monotonic_ns())
            observers.notify(record)
            self.tick += 1
        assert not observers.failures


@contextmanager
def running_robot(**config: Any) -> Iterator[tuple[Loop, str]]:
    """Give a robot that is publishing, and its endpoint."""
    endpoint = free_endpoint()
    with Telemetry(TelemetryConfig(endpoint=endpoint, **config), "fake", True, 500.0) as telemetry:
        loop, done = Loop(telemetry), threading.Event()
        thread = threading.Thread(target=loop.run, args=(done,))
        thread.start()
        try:
            yield loop, endpoint
        finally:
            done.set()
            thread.join()


@contextmanager
def client(endpoint: str) -> Iterator[zenoh.Session]:
    """Give a session that is connected to a robot."""
    with open_session(client_settings(endpoint)) as session:
        yield session


def ask(session: zenoh.Session, key: str, payload: bytes | None = None) -> list[dict[str, Any]]:
    """Return the answers to a query."""
    replies = session.get(key, payload=payload, timeout=5.0, consolidation=zenoh.ConsolidationMode.NONE)
    return [json.loads(reply.ok.payload.to_bytes()) for reply in replies if reply.ok is not None]


def request(seq: int, client: str = "test", ahead_s: float = 5.0, **more: Any) -> bytes:
    """Return a request's payload."""
    expires_ns = time.time_ns() + round(ahead_s * 1e9)
    fields = {"schema": "preshape/request/1", "client": client, "seq": seq, "expires_ns": expires_ns}
    return json.dumps(fields | more).encode()


def until(condition: Any, within_s: float = 5.0) -> bool:
    """Wait until something holds; return whether it does."""
    deadline = time.monotonic() + within_s
    while not condition() and time.monotonic() < deadline:
        time.sleep(0.01)
    return bool(condition())
