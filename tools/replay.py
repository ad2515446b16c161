"""A recorded run once more: the same inputs through controller, gate and loop, the commands compared bit for bit."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from preshape.control.controller import Controller
from preshape.control.loop import ControlLoop
from preshape.control.loop_result import LoopConfig
from preshape.control.observer import Observer, Observers
from preshape.hal.device import DeviceUnreachable
from preshape.hal.gate import SafetyGate
from preshape.hal.layout import LAYOUT
from preshape.hal.recording import Recording, RecordingError
from preshape.hal.replay import ReplayClock, ReplayDevice, ReplayEnded, ReplayPerception, recorded_state
from preshape.hal.tick_record import TickRecord, text_of
from preshape.tools.controller_setup import ControllerSetup
from preshape.tools.replay_patient import ReplayPatient, paces

COMPARED = ("commanded", "command_mode", "command_sequence", "target", "torque_limit", "torque_target")
"""What of a tick must be equal, in the order in which a difference is named."""


@dataclass(frozen=True, slots=True)
class Difference:
    """The first tick whose command is another one.

    `row` counts the recorded ticks, `tick` is the controller's number of it, `time_s` counts from the first.
    """

    row: int
    tick: int
    time_s: float
    task: int
    phase: str
    what: str

    def __str__(self) -> str:
        where = f"tick {self.tick} ({self.time_s:.3f} s, task {self.task}, {self.phase or 'no phase'})"
        return f"{where}: {self.what}"


@dataclass(frozen=True, slots=True)
class Replayed:
    """What came of a replay.

    `ticks` were recorded, `compared` of them compared, `commands` of these written; `end` says why it did not go on
    to the last one, empty if it did; `wall_s` is how long it took.
    """

    ticks: int
    compared: int
    commands: int
    difference: Difference | None
    end: str
    wall_s: float

    @property
    def equal(self) -> bool:
        """Whether every recorded command was written again, bit for bit."""
        return self.difference is None and not self.end


def first_difference(recorded: TickRecord, replayed: TickRecord) -> str:
    """Return what differs in the commands of one tick, with the joint's name; an empty text if nothing does."""
    for name in COMPARED:
        before, now = recorded[name], replayed[name]
        if before.tobytes() == now.tobytes():
            continue
        if before.ndim == 0:
            return f"{name} was {before.item()}, is {now.item()}"
        joint = int(np.argmax(before.view(np.int64) != now.view(np.int64)))
        return f"{name} of {LAYOUT.names[joint]} was {float(before[joint])!r}, is {float(now[joint])!r}"
    return ""


class Comparison:
    """The observer that compares each tick with the recorded one; `difference` stays at the first."""

    def __init__(self, ticks: TickRecord) -> None:
        """Compare with recorded ticks (n,)."""
        self._ticks = ticks
        self.compared = self.commands = 0
        self.difference: Difference | None = None

    def notify(self, record: TickRecord) -> None:
        """Compare one tick."""
        if self.difference is not None:
            return
        recorded = self._ticks[self.compared]
        what = first_difference(recorded, record)
        if what:
            time_s = (int(recorded["now_ns"]) - int(self._ticks["now_ns"][0])) * 1e-9
            phase = text_of(recorded, "phase")
            task, tick = int(recorded["task"]), int(recorded["tick"])
            self.difference = Difference(self.compared, tick, time_s, task, phase, what)
            return
        self.compared += 1
        self.commands += bool(record["commanded"])


class RecordedOrders:
    """The observer that asks the loop for the stop that was asked for, before the tick that knew of it."""

    def __init__(self, ticks: TickRecord, loop: ControlLoop | None = None) -> None:
        """Take the stop from recorded ticks (n,)."""
        asked = np.flatnonzero(ticks["stop_reason"] != b"")
        self._row = int(asked[0]) if len(asked) else -1
        self._reason = text_of(ticks[self._row], "stop_reason") if len(asked) else ""
        self._seen = 0
        self.loop = loop

    def notify(self, record: TickRecord) -> None:
        """Count one tick; the order that the next one must know is given now."""
        self._seen += 1
        self.order()

    def order(self) -> None:
        """Give the order if the next tick must know of it."""
        if self._seen == self._row and self.loop is not None:
            self.loop.request_stop(self._reason)


def replay(recording: Recording, setup: ControllerSetup, observers: Sequence[Observer] = ()) -> Replayed:
    """Feed a recording through a controller made from `setup`; ends at the first difference.

    `RecordingError` when it holds no ticks. Observers are told of the replayed ticks.
    """
    ticks = recording.ticks
    if recording.gap is not None:
        ticks = ticks[: int(np.searchsorted(ticks["tick"], recording.gap))]
    if not len(ticks):
        raise RecordingError("the recording holds no ticks")
    if setup.paced and not ticks["begun"].any():
        raise RecordingError("a run in real time of an earlier version: it does not say when steps were begun")
    inner = setup.controller(ReplayPerception(recording))
    controller = ReplayPatient(inner, paces(ticks), 1.0 / setup.loop.rate_hz) if setup.paced else inner
    return replay_ticks(ticks, controller, setup.loop, SafetyGate(setup.gate), observers)


def replay_ticks(
    ticks: TickRecord, controller: Controller, config: LoopConfig, gate: SafetyGate, observers: Sequence[Observer] = ()
) -> Replayed:
    """Run a loop over recorded ticks (n,), n >= 1, and compare what it writes."""
    comparison, orders = Comparison(ticks), RecordedOrders(ticks)
    clock = ReplayClock(ticks, lambda: comparison.difference is not None)
    device = ReplayDevice((recorded_state(tick) for tick in ticks), ticks["taken"][ticks["commanded"]].tolist())
    watching = Observers([comparison, orders, *observers])
    loop = ControlLoop(device, clock, gate, watching, time.perf_counter_ns, config)
    orders.loop = loop
    orders.order()
    started = time.perf_counter()
    end = _run(loop, controller)
    if comparison.compared == len(ticks):
        end = ""
    elif comparison.difference is None and not end:
        end = f"the loop ended after {comparison.compared} of {len(ticks)} ticks"
    wall_s = time.perf_counter() - started
    return Replayed(len(ticks), comparison.compared, comparison.commands, comparison.difference, end, wall_s)


def _run(loop: ControlLoop, controller: Controller) -> str:
    """Run the loop and return what ended it from outside, an empty text if nothing did."""
    try:
        loop.run(controller)
    except ReplayEnded as error:
        return str(error)
    except DeviceUnreachable as error:
        return f"the recorded failure of a device: {error}"
    except (ArithmeticError, AssertionError, LookupError, RuntimeError, TypeError, ValueError) as error:
        return f"the controller's {type(error).__name__}: {error}"
    return ""
