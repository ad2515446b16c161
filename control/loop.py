"""The loop: read -> step -> gate -> write -> notify, at a fixed rate, on whatever clock it is given.

Deadlines are absolute. The clock is read once a tick and passed in; with a clock that advances a
simulation in `sleep_until_ns` the loop runs in lockstep, with the machine's own it is paced. A late tick
advances the controller by one nominal period; deadlines missed altogether are skipped, never caught up.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable

from preshape.control.braking import Braking
from preshape.control.controller import Controller, Setpoint
from preshape.control.loop_result import LoopConfig, LoopOutcome, LoopResult
from preshape.control.modes import WRITING, LoopEvent, LoopMode, next_mode
from preshape.control.observer import Observer
from preshape.control.timing import LoopTiming, quiet_collector
from preshape.hal.clock import Clock
from preshape.hal.device import Device
from preshape.hal.gate import SafetyGate
from preshape.hal.gate_config import GateVerdict
from preshape.hal.state import DeviceStatus, Mode, RobotCommand, RobotState
from preshape.hal.tick_record import as_bytes, new_record, note_command, note_state, note_stop, note_timing


def next_deadline(deadline_ns: int, now_ns: int, period_ns: int) -> int:
    """Return the deadline after a tick due at deadline_ns that began at now_ns: the first on the grid after both."""
    missed = max(0, now_ns - deadline_ns) // period_ns
    return deadline_ns + (missed + 1) * period_ns


class ControlLoop:
    """One run of one controller on one open device; make a new one for the next run.

    `stopwatch` measures compute time only, never decides anything; nothing else reads real time.
    """

    def __init__(
        self,
        device: Device,
        clock: Clock,
        gate: SafetyGate,
        observer: Observer,
        stopwatch: Callable[[], int],
        config: LoopConfig | None = None,
    ) -> None:
        self.config = config or LoopConfig()
        self.period_ns = round(1e9 / self.config.rate_hz)
        if abs(gate.config.period_s * 1e9 - self.period_ns) > 1.0:
            raise ValueError(
                f"gate period: got {gate.config.period_s} s, allowed is {self.period_ns * 1e-9} s of rate_hz"
            )
        self.mode = LoopMode.DISARMED
        self.timing = LoopTiming(self.period_ns)
        self._device, self._clock, self._gate = device, clock, gate
        self._braking = Braking(gate)
        self._observer, self._stopwatch = observer, stopwatch
        self._record = new_record()
        self._hash = hashlib.sha256()
        self._ticks = self._written = self._refused = self._refused_in_a_row = 0
        self._since_ns = self._sequence = 0
        self._asked = self._stop_reason = self._reason = ""
        self._outcome = LoopOutcome.SAFETY_STOP

    def request_stop(self, reason: str) -> None:
        """Ask for a braked stop, from any thread or signal handler; the first reason stays."""
        self._asked = self._asked or reason or "no reason given"

    def run(self, controller: Controller) -> LoopResult:
        """Arm, run the controller until it has finished or something ends it, leave the device stopped.

        Calling it is the explicit order to arm; after a stop that was asked for before, nothing is armed. An exception
        of the controller stops the device and goes on up.
        """
        if self.mode is not LoopMode.DISARMED:
            raise RuntimeError("this loop has run: make a new one")
        try:
            with quiet_collector():
                # Collecting takes tens of milliseconds: time begins after it.
                now_ns = self._clock.now_ns()
                if self._asked:
                    self._end(LoopEvent.STOP, LoopOutcome.STOPPED, self._asked, now_ns)
                else:
                    self._arm(now_ns)
                now_ns = self._spin(controller, now_ns)
        except BaseException as error:
            self._device.stop(f"the loop ended with {type(error).__name__}: {error}", self._clock.now_ns())
            raise
        self._settle(now_ns)
        return LoopResult(
            self._outcome, self._reason, self._ticks, self._written, self._refused, self._hash.hexdigest(),
            self.timing.report(),
        )  # fmt: skip

    def _arm(self, now_ns: int) -> None:
        self._enter(LoopEvent.ARM, now_ns)
        try:
            self._device.arm(now_ns)
        except RuntimeError as error:
            self._end(LoopEvent.FAULT, LoopOutcome.SAFETY_STOP, f"not armed: {error}", now_ns)

    def _settle(self, now_ns: int) -> None:
        """Leave everything stopped, whatever the run ended with."""
        if self.mode is not LoopMode.STOPPED:
            self._enter(LoopEvent.STOP, now_ns)
        self._gate.stop(self._reason)
        self._device.stop(self._reason, now_ns)

    def _spin(self, controller: Controller, now_ns: int) -> int:
        deadline_ns = now_ns
        while not self._reason:
            self._clock.sleep_until_ns(deadline_ns)
            now_ns = self._clock.now_ns()
            started = self._stopwatch()
            lateness_ns = max(0, now_ns - deadline_ns)
            self._tick(controller, now_ns)
            note_timing(self._record, lateness_ns, self._stopwatch() - started)
            controller.note(self._record)
            self._record["mode"] = as_bytes(self.mode.value)
            self._observer.notify(self._record)
            self.timing.add(lateness_ns, self._stopwatch() - started)
            deadline_ns = next_deadline(deadline_ns, now_ns, self.period_ns)
        return now_ns

    def _tick(self, controller: Controller, now_ns: int) -> None:
        state = self._device.read(now_ns)
        note_state(self._record, self._ticks, now_ns, state)
        # What is asked for from now on counts in the next tick: a recording says what this one knew.
        self._stop_reason = self._asked
        note_stop(self._record, self._stop_reason)
        self._take_orders(controller, now_ns, state)
        setpoint = None
        if self.mode is LoopMode.RUNNING:
            setpoint = controller.step(self._ticks, now_ns, state)
            self._ticks += 1
        verdict = self._pass_gate(now_ns, state, setpoint)
        note_command(self._record, *self._write(now_ns))
        if setpoint is not None and verdict in (GateVerdict.CLIPPED, GateVerdict.BRAKED):
            controller.follow(self._gate.position, self._gate.step / self._gate.config.period_s)
        if self.mode is LoopMode.RUNNING and setpoint is not None:
            self._judge_end(setpoint, now_ns)

    def _take_orders(self, controller: Controller, now_ns: int, state: RobotState) -> None:
        """Change the mode for what has come from the device, the operator, or with time."""
        if self._stop_reason and self.mode is LoopMode.RUNNING:
            self._braking.begin()
            self._enter(LoopEvent.STOP, now_ns)
        elif self._stop_reason and self.mode in (LoopMode.ARMING, LoopMode.HOLDING):
            self._end(LoopEvent.STOP, LoopOutcome.STOPPED, self._stop_reason, now_ns)
        elif self.mode is LoopMode.HOLDING:
            controller.follow(self._gate.position, self._gate.step)
            self._enter(LoopEvent.START, now_ns)
        elif self.mode is LoopMode.ARMING:
            self._await_armed(now_ns, state)

    def _await_armed(self, now_ns: int, state: RobotState) -> None:
        if state.status is DeviceStatus.ARMED and self._gate.arm(now_ns, state):
            self._sequence = state.sequence
            self._enter(LoopEvent.ARMED, now_ns)
        elif now_ns - self._since_ns > self.config.arming_s * 1e9:
            cause = self._gate.reason or f"device is {state.status.name} {state.fault}".rstrip()
            reason = f"not armed within {self.config.arming_s:g} s: {cause}"
            self._end(LoopEvent.FAULT, LoopOutcome.SAFETY_STOP, reason, now_ns)

    def _pass_gate(self, now_ns: int, state: RobotState, setpoint: Setpoint | None) -> GateVerdict:
        position = torque_limit = None
        if setpoint is not None:
            position, torque_limit = setpoint.position, setpoint.torque_limit
        elif self.mode is LoopMode.STOPPING:
            position, torque_limit = self._braking.step(), self._gate.torque_limit
        self._braking.note()
        verdict = self._gate.check(now_ns, state, position, torque_limit)
        if self.mode not in WRITING:
            return verdict
        if verdict is GateVerdict.STOPPED:
            self._end(LoopEvent.FAULT, LoopOutcome.SAFETY_STOP, self._gate.reason, now_ns)
        elif self.mode is LoopMode.STOPPING:
            self._judge_braking(now_ns)
            if verdict is not GateVerdict.PASSED:
                self._braking.begin()
        return verdict

    def _judge_braking(self, now_ns: int) -> None:
        if self._gate.at_rest:
            self._end(LoopEvent.AT_REST, LoopOutcome.STOPPED, self._stop_reason, now_ns)
        elif now_ns - self._since_ns > self.config.stopping_s * 1e9:
            reason = f"not at rest within {self.config.stopping_s:g} s: {self._stop_reason}"
            self._end(LoopEvent.FAULT, LoopOutcome.SAFETY_STOP, reason, now_ns)

    def _write(self, now_ns: int) -> tuple[RobotCommand | None, bool]:
        """Write the gate's output if the mode allows; return the command and whether it was taken."""
        if self.mode not in WRITING:
            return None, False
        self._sequence += 1
        command = RobotCommand(self._sequence, Mode.POSITION, self._gate.position, self._gate.torque_limit)
        taken = self._device.write(command, now_ns)
        self._written += 1
        self._hash.update(command.position.tobytes())
        self._hash.update(command.torque_limit.tobytes())
        self._refused += not taken
        self._refused_in_a_row = 0 if taken else self._refused_in_a_row + 1
        if self._refused_in_a_row >= self.config.refused_ticks:
            self._gate.stop(f"device refused {self._refused_in_a_row} commands in a row")
            self._end(LoopEvent.FAULT, LoopOutcome.SAFETY_STOP, self._gate.reason, now_ns)
        return command, taken

    def _judge_end(self, setpoint: Setpoint, now_ns: int) -> None:
        if setpoint.finished:
            self._end(LoopEvent.FINISH, LoopOutcome.FINISHED, "the controller has finished", now_ns)
        elif self._ticks >= self.config.max_ticks:
            self._end(LoopEvent.FINISH, LoopOutcome.TIME_UP, f"{self.config.max_ticks} ticks are over", now_ns)

    def _enter(self, event: LoopEvent, now_ns: int) -> None:
        self.mode = next_mode(self.mode, event)
        self._since_ns = now_ns

    def _end(self, event: LoopEvent, outcome: LoopOutcome, reason: str, now_ns: int) -> None:
        self._enter(event, now_ns)
        self._outcome, self._reason = outcome, reason
