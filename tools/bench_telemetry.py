"""What telemetry costs the loop, and what arrives: with none, one and ten subscribers, one stopped and one slow.

The loop here is one in real time at 500 Hz, with the priority of the real one, that does the same work each tick, some
300 us of it, and notes what it did, in turns with telemetry and without, a second each: what differs between the turns
is telemetry alone, and what it takes away from the work shows.
"""

from __future__ import annotations

import socket
import time

import numpy as np
from numpy.typing import NDArray

from preshape.hal.layout import LAYOUT
from preshape.hal.state import DeviceStatus, Mode, RobotCommand, RobotState
from preshape.hal.tick_record import TickRecord, new_record, note_command, note_progress, note_state, note_timing
from preshape.tools.bench_subscribers import Kind, Subscribers
from preshape.tools.real_time import real_time
from preshape.tools.telemetry import Telemetry
from preshape.tools.telemetry_config import TelemetryConfig

PERIOD_NS = 2_000_000
TURN_TICKS = 500
TURNS = 8
WORK_NS = 300_000
"""How long the work of a tick takes when nothing disturbs it, ns."""
CALIBRATIONS = 50
"""Trials from which the amount of work is found."""
PHASE_TICKS = 25
"""Ticks between two events."""
TEN: tuple[Kind, ...] = (*("live" for _ in range(8)), "slow", "stopped")
SUBSCRIBERS: tuple[tuple[Kind, ...], ...] = ((), ("live",), TEN)


def bench_telemetry() -> dict[str, float]:
    """Return what a tick pays for telemetry by the number of subscribers, and what ten of them get."""
    figures: dict[str, float] = {}
    for kinds in SUBSCRIBERS:
        run, count = _Run(kinds), len(kinds)
        figures |= {f"tick_{count}_subscribers_us": run.paid_us, f"tick_{count}_p99_us": run.paid_p99_us}
        if kinds == TEN:
            figures |= run.compared() | run.delivered()
    return figures


class _Run:
    """One run with so many subscribers."""

    def __init__(self, kinds: tuple[Kind, ...]) -> None:
        endpoint = _free_endpoint()
        with Telemetry(TelemetryConfig(endpoint=endpoint), "bench", True, 1e9 / PERIOD_NS) as telemetry:
            with Subscribers(endpoint, kinds) as subscribers:
                loop = _Loop(telemetry)
                with real_time():
                    for turn in range(TURNS):
                        loop.turn(with_telemetry=turn % 2 == 1)
                time.sleep(1.0)
                self.received = subscribers.finish()
        self.compute_us = {on: np.array(times) * 1e-3 for on, times in loop.compute_ns.items()}
        paid = np.array(loop.paid_ns) * 1e-3
        self.paid_us, self.paid_p99_us = float(np.median(paid)), float(np.percentile(paid, 99))

    def compared(self) -> dict[str, float]:
        """Return compute with telemetry over compute without, median and 99th percentile."""
        off, on = (np.percentile(self.compute_us[which], [50.0, 99.0]) for which in (False, True))
        return {"compute_p50_ratio": float(on[0] / off[0]), "compute_p99_ratio": float(on[1] / off[1])}

    def delivered(self) -> dict[str, float]:
        """Return what the live subscribers missed: events, and the share of states that a gap shows."""
        live = [one for one in self.received if one.kind == "live"]
        slow = [one for one in self.received if one.kind == "slow"]
        states = sum(one.states + one.states_lost for one in live)
        # All were there before the first event, which has number 0.
        happened = max((one.last_event for one in self.received), default=-1) + 1
        return {
            "live_subscribers": float(len(live)),
            "events_happened": float(happened),
            "events_missing": float(sum(happened - one.events for one in live)),
            "states_lost_share": sum(one.states_lost for one in live) / max(1, states),
            "slow_subscriber_lost_share": sum(one.states_lost for one in slow)
            / max(1, sum(one.states + one.states_lost for one in slow)),
        }


class _Loop:
    """A loop that computes, notes and tells, as the real one does."""

    def __init__(self, telemetry: Telemetry) -> None:
        self._observers = telemetry.observers(lambda reason: None)
        self._record: TickRecord = new_record()
        self._matrix: NDArray[np.float64] = np.random.default_rng(0).normal(size=(LAYOUT.dof, LAYOUT.dof))
        self._tick = 0
        self._steps = 100
        fastest_ns = min(self._work_ns() for _ in range(CALIBRATIONS))
        self._steps = max(1, round(self._steps * WORK_NS / fastest_ns))
        self.compute_ns: dict[bool, list[int]] = {False: [], True: []}
        self.paid_ns: list[int] = []

    def turn(self, with_telemetry: bool) -> None:
        """Tick for a second."""
        due_ns = time.monotonic_ns()
        for _ in range(TURN_TICKS):
            due_ns += PERIOD_NS
            time.sleep(max(0, due_ns - time.monotonic_ns()) * 1e-9)
            started = time.perf_counter_ns()
            self._compute()
            told = time.perf_counter_ns()
            if with_telemetry:
                for observer in self._observers:
                    observer.notify(self._record)
                self.paid_ns.append(time.perf_counter_ns() - told)
            self.compute_ns[with_telemetry].append(time.perf_counter_ns() - started)
            self._tick += 1

    def _work_ns(self) -> int:
        started = time.perf_counter_ns()
        self._work()
        return time.perf_counter_ns() - started

    def _work(self) -> NDArray[np.float64]:
        x = np.ones(LAYOUT.dof)
        for _ in range(self._steps):
            x = self._matrix @ x
            x /= np.linalg.norm(x)
        return x

    def _compute(self) -> None:
        now_ns, x = time.monotonic_ns(), self._work()
        stamps = np.full(LAYOUT.dof, now_ns)
        note_state(self._record, self._tick, now_ns, RobotState(self._tick, x, x, x, stamps, DeviceStatus.ARMED))
        note_command(self._record, RobotCommand(self._tick, Mode.POSITION, x, LAYOUT.torque), True)
        note_progress(self._record, 1, f"phase {self._tick // PHASE_TICKS}", "running", None)
        note_timing(self._record, 0, WORK_NS)


def _free_endpoint() -> str:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


if __name__ == "__main__":
    for name, value in bench_telemetry().items():
        print(f"{name:32s} {value:12.4f}")
