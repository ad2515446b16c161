"""A stop over Zenoh while the hands close: at once, in the least time, latched."""

from __future__ import annotations

import threading
import time

import numpy as np
import pytest
from kinematic_device import START, KinematicDevice
from manual_clock import ManualClock
from stop_time import assert_stops_in_least_time
from zenoh_robot import ask, client, free_endpoint, request, running_robot, until

from preshape.control.controller import Setpoint
from preshape.control.loop import ControlLoop
from preshape.control.loop_result import LoopOutcome
from preshape.control.observer import Observers
from preshape.hal.clock import MonotonicClock
from preshape.hal.gate import SafetyGate
from preshape.hal.layout import LAYOUT, SIDES
from preshape.hal.state import DeviceStatus, RobotState
from preshape.hal.tick_record import TickRecord, note_progress, text_of
from preshape.tools.run_options import RunOptions
from preshape.tools.standby import await_start
from preshape.tools.telemetry import Telemetry
from preshape.tools.telemetry_config import TelemetryConfig

SPEED = 0.4
"""At which the fingers close, rad/s."""


class Closing:
    """A controller that closes both hands evenly; `closing` is set once it is under way."""

    def __init__(self) -> None:
        self.closing = threading.Event()
        self._joints = np.concatenate([np.arange(LAYOUT.dof)[LAYOUT.hand(side)] for side in SIDES])

    def step(self, tick: int, now_ns: int, state: RobotState) -> Setpoint:
        """Move every finger joint on."""
        position = START.copy()
        eased = 0.02 * max(0, tick - 100) + 0.0001 * min(tick, 100) ** 2
        position[self._joints] += SPEED * 0.1 * eased
        if tick == 120:
            self.closing.set()
        return Setpoint(position, LAYOUT.torque)

    def follow(self, position: np.ndarray, velocity: np.ndarray) -> None:
        """Nothing is kept."""

    def note(self, record: TickRecord) -> None:
        """Say what it does."""
        note_progress(record, 1, "close", "", None)


class Clock(MonotonicClock):
    """The machine's clock, which takes the device along."""

    def __init__(self, device: KinematicDevice) -> None:
        super().__init__()
        self._device = device

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """Sleep, then let the joints move until now."""
        super().sleep_until_ns(deadline_ns)
        self._device.advance(self.now_ns())


class Recorder:
    """Keeps every tick."""

    def __init__(self) -> None:
        self.records: list[TickRecord] = []

    def notify(self, record: TickRecord) -> None:
        """Keep a copy of one tick."""
        self.records.append(record.copy())


@pytest.mark.parametrize("key", ["preshape/box/call/stop", "preshape/*/call/stop", "preshape/**/call/stop"])
def test_a_stop_by_its_name_is_obeyed_for_every_robot_there_is(key: str) -> None:
    with running_robot() as (loop, endpoint), client(endpoint) as session:
        # Whoever asks for everything there is to read does not mean it.
        assert ask(session, "preshape/**") and ask(session, "preshape/*/call/*") == []
        (answer,) = ask(session, "preshape/box/param/stop")
        assert answer["code"] == "unknown" and loop.stops == []
        answers = ask(session, key, request(1, reason="enough"))
        assert [(answer["service"], answer["code"]) for answer in answers] == [("call/stop", "done")]
        assert until(lambda: loop.stops == ["test: enough"])


def test_a_stop_is_obeyed_whatever_comes_with_it() -> None:
    with running_robot() as (loop, endpoint), client(endpoint) as session:
        assert [answer["code"] for answer in ask(session, "preshape/box/call/stop", b'{"schema":' + 3000 * b"[")] == [
            "done"
        ]
        assert until(lambda: loop.stops == ["asked for over Zenoh"])


def test_a_run_that_was_stopped_while_it_waited_is_never_armed() -> None:
    endpoint, device = free_endpoint(), KinematicDevice()
    device.open()
    loop = ControlLoop(device, Clock(device), SafetyGate(), Observers(), time.perf_counter_ns)
    with Telemetry(TelemetryConfig(endpoint=endpoint, services=("start",)), "kinematic", True, 500.0) as telemetry:
        with client(endpoint) as session:
            ask(session, "preshape/box/call/stop", request(1, reason="enough"))
        await_start(telemetry.orders, RunOptions())
        telemetry.watch(loop, Observers())
        result = loop.run(Closing())
    assert (result.outcome, result.reason, result.ticks) == (LoopOutcome.STOPPED, "test: enough", 0)
    assert not device.written and device.status is not DeviceStatus.ARMED


def rehearse() -> None:
    """Do without a clock what the test below does in real time: kernels that are compiled or loaded would stall it."""
    device, controller = KinematicDevice(), Closing()
    device.open()
    observers = Observers()
    loop = ControlLoop(device, ManualClock(device.advance), SafetyGate(), observers, lambda: 0)
    observers.add(OrdersOnceClosing(controller, loop))
    assert loop.run(controller).outcome is LoopOutcome.STOPPED


class OrdersOnceClosing:
    """Asks for a stop as soon as the hands close."""

    def __init__(self, controller: Closing, loop: ControlLoop) -> None:
        self._controller, self._loop = controller, loop

    def notify(self, record: TickRecord) -> None:
        """Look whether they do."""
        if self._controller.closing.is_set():
            self._loop.request_stop("enough")


def test_a_stop_while_the_hand_closes_brakes_at_once_and_is_latched() -> None:
    rehearse()
    endpoint, device, controller, recorder = free_endpoint(), KinematicDevice(), Closing(), Recorder()
    device.open()
    observers, gate = Observers([recorder]), SafetyGate()
    loop = ControlLoop(device, Clock(device), gate, observers, time.perf_counter_ns)
    answers, sent_ns = [], []

    def operate() -> None:
        with client(endpoint) as session:
            assert controller.closing.wait(60.0)
            sent_ns.append(time.monotonic_ns())
            answers.extend(ask(session, "preshape/box/call/stop", request(1, reason="enough")))

    with Telemetry(TelemetryConfig(endpoint=endpoint), "kinematic", True, 500.0) as telemetry:
        telemetry.watch(loop, observers)
        operator = threading.Thread(target=operate)
        operator.start()
        result = loop.run(controller)
        operator.join()
    assert (result.outcome, result.reason) == (LoopOutcome.STOPPED, "test: enough")
    assert [answer["code"] for answer in answers] == ["done"] and not observers.failures
    records = np.array(recorder.records)
    asked = int(np.argmax(records["stop_reason"] == b"test: enough"))
    # The tick that learns of it already brakes; a client needs a few milliseconds to be heard.
    assert bytes(records["mode"][asked]) == b"stopping"
    assert 0 < records["now_ns"][asked] - sent_ns[0] < 1e9
    dt = gate.config.period_s
    before = (records["target"][asked - 1] - records["target"][asked - 2]) / dt
    assert before[LAYOUT.hand("right")].min() > 0.1
    # Commands from this one on come to rest in ruckig's least time.
    assert_stops_in_least_time(records["target"][asked - 3 :][records["commanded"][asked - 3 :]], dt)
    # Latched: nothing is taken any more, and only arming anew, by a new loop, changes that.
    assert device.status is DeviceStatus.STOPPED and device.stops == ["test: enough"]
    assert text_of(records[-1], "mode") == "stopped"
    assert not gate.armed and gate.reason == "test: enough"
