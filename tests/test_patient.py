"""Laws of the patient controller: it holds while the inner one thinks, loses nothing, and passes errors on."""

from __future__ import annotations

import signal
import time
from threading import Event, Timer

import numpy as np
import pytest

from preshape.control.controller import Setpoint
from preshape.hal.layout import LAYOUT
from preshape.hal.state import RobotState, Vector
from preshape.hal.tick_record import TickRecord
from preshape.tools.patient import PatientController

PATIENT_S = 20.0
"""Longer than any machine stalls: these laws are not about time."""
PERIOD_S = 0.002
MIDDLE = 0.5 * (LAYOUT.lower + LAYOUT.upper)


class Inner:
    """Answers each step with its number; blocks in the steps that are given, until let go."""

    def __init__(self, slow: tuple[int, ...] = (), broken: tuple[int, ...] = ()) -> None:
        self.slow, self.broken = slow, broken
        self.go_on, self.thinking = Event(), Event()
        self.calls: list[tuple[str, float]] = []
        self._position = np.zeros(LAYOUT.dof)

    def step(self, tick: int, now_ns: int, state: RobotState) -> Setpoint:
        self.calls.append(("step", tick))
        if tick in self.slow:
            self.thinking.set()
            assert self.go_on.wait(PATIENT_S)
        if tick in self.broken:
            raise ValueError(f"broken at {tick}")
        self._position[:] = tick
        return Setpoint(self._position, LAYOUT.torque, finished=tick == 9)

    def follow(self, position: Vector, velocity: Vector) -> None:
        self.calls.append(("follow", float(position[0])))

    def note(self, record: TickRecord) -> None:
        self.calls.append(("note", 0.0))


def state() -> RobotState:
    zero = np.zeros(LAYOUT.dof)
    return RobotState(0, zero, zero, zero, np.zeros(LAYOUT.dof, np.int64))


def test_quick_steps_pass_through_one_by_one() -> None:
    inner = Inner()
    with PatientController(inner, PATIENT_S, PERIOD_S) as patient:
        patient.follow(np.full(LAYOUT.dof, 0.5), np.zeros(LAYOUT.dof))
        answers = [patient.step(tick, 0, state()) for tick in range(10)]
    assert [answer.position[0] for answer in answers] == list(range(10))
    assert [answer.finished for answer in answers] == [False] * 9 + [True]
    assert inner.calls[:2] == [("follow", 0.5), ("step", 0)]
    assert patient.held == 0


def test_while_the_inner_one_thinks_nothing_moves_that_stood_and_none_of_its_steps_is_skipped() -> None:
    inner = Inner(slow=(1,))
    with PatientController(inner, PATIENT_S, PERIOD_S) as patient:
        first = patient.step(0, 0, state())
        patient._patience_s = 0.0
        assert patient.step(1, 0, state()).position[0] == first.position[0]
        assert inner.thinking.wait(PATIENT_S)
        held = [patient.step(tick, 0, state()) for tick in range(2, 6)]
        assert all(np.all(setpoint.position == 0.0) and not setpoint.finished for setpoint in held)
        patient.follow(np.full(LAYOUT.dof, 7.0), np.zeros(LAYOUT.dof))
        assert patient.held == 5
        inner.go_on.set()
        patient._patience_s = PATIENT_S
        # What step 1 says is late: the inner controller goes on from what was commanded meanwhile.
        assert _until_ready(patient).position[0] == 2.0
        assert patient.step(7, 0, state()).position[0] == 3.0
    assert inner.calls == [("step", 0), ("step", 1), ("follow", 7.0), ("step", 2), ("step", 3)]


def _until_ready(patient: PatientController) -> Setpoint:
    """Return the first setpoint that is not held; an overdue step is looked for, not waited for."""
    held, deadline_s = patient.held, time.monotonic() + PATIENT_S
    while True:
        setpoint = patient.step(6, 0, state())
        if patient.held == held:
            return setpoint
        held = patient.held
        assert time.monotonic() < deadline_s
        time.sleep(0.001)


class Mover:
    """Moves all joints at a steady speed, from whatever it is told to follow; blocks in one step until let go."""

    def __init__(self, speed: float, slow: int) -> None:
        self.slow, self.go_on, self.thinking = slow, Event(), Event()
        self._position, self._velocity = MIDDLE, np.full(LAYOUT.dof, speed)
        self._change = 0.5 * LAYOUT.acceleration * PERIOD_S
        self._speed = speed

    def step(self, tick: int, now_ns: int, state: RobotState) -> Setpoint:
        if tick == self.slow:
            self.thinking.set()
            assert self.go_on.wait(PATIENT_S)
        self._velocity = np.minimum(self._velocity + self._change, self._speed)
        self._position = self._position + PERIOD_S * self._velocity
        return Setpoint(self._position, LAYOUT.torque)

    def follow(self, position: Vector, velocity: Vector) -> None:
        self._position, self._velocity = position.copy(), velocity.copy()

    def note(self, record: TickRecord) -> None:
        """Nothing to say."""


@pytest.mark.parametrize("ticks", [1, 3, 20, 400])
def test_a_step_that_is_late_in_the_middle_of_a_motion_asks_no_joint_to_jump(ticks: int) -> None:
    arm = LAYOUT.arm("right")
    speed = 0.5 * float(LAYOUT.velocity[arm].min())
    mover = Mover(speed, slow=20)
    with PatientController(mover, PATIENT_S, PERIOD_S) as patient:
        patient.follow(MIDDLE, np.full(LAYOUT.dof, speed))
        positions = [patient.step(tick, 0, state()).position.copy() for tick in range(20)]
        patient._patience_s = 0.0
        positions.append(patient.step(20, 0, state()).position.copy())
        assert mover.thinking.wait(PATIENT_S)
        positions += [patient.step(21 + tick, 0, state()).position.copy() for tick in range(ticks)]
        assert patient.held == ticks + 1
        patient._patience_s = PATIENT_S
        mover.go_on.set()
        while (held := patient.held) == ticks + 1 or held != patient.held:
            positions.append(patient.step(0, 0, state()).position.copy())
            if patient.held == held:
                break
            time.sleep(0.001)
        positions += [patient.step(0, 0, state()).position.copy() for _ in range(50)]
    velocity = np.diff(np.array(positions)[:, arm], axis=0) / PERIOD_S
    assert (velocity > -1e-9).all() and (velocity < 1.001 * speed).all()
    assert (np.abs(np.diff(velocity, axis=0)) < 1.01 * LAYOUT.acceleration[arm] * PERIOD_S).all()


def test_holds_the_first_command_to_follow_before_the_first_step_is_ready() -> None:
    inner = Inner(slow=(0,))
    with PatientController(inner, 0.0, PERIOD_S) as patient:
        patient.follow(np.full(LAYOUT.dof, 0.25), np.zeros(LAYOUT.dof))
        setpoint = patient.step(0, 0, state())
        inner.go_on.set()
    assert np.all(setpoint.position == 0.25)
    assert np.array_equal(setpoint.torque_limit, LAYOUT.torque)


def test_a_signal_while_a_tick_waits_for_its_step_does_not_make_it_wait_for_ever() -> None:
    inner = Inner(slow=(0,))
    waited_s = 0.01
    before = signal.signal(signal.SIGALRM, lambda number, frame: time.sleep(5 * waited_s))
    try:
        with PatientController(inner, waited_s, PERIOD_S) as patient:
            patient.follow(MIDDLE, np.zeros(LAYOUT.dof))
            timer = Timer(PATIENT_S / 10, inner.go_on.set)
            timer.start()
            signal.setitimer(signal.ITIMER_REAL, 0.5 * waited_s)
            patient.step(0, 0, state())
            assert patient.held == 1 and not inner.go_on.is_set()
            inner.go_on.set()
            timer.cancel()
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)


def test_an_error_of_the_inner_controller_comes_up_in_the_loop() -> None:
    with PatientController(Inner(broken=(1,)), PATIENT_S, PERIOD_S) as patient:
        patient.step(0, 0, state())
        with pytest.raises(ValueError, match="broken at 1"):
            patient.step(1, 0, state())


def test_a_held_setpoint_does_not_change_under_the_next_step() -> None:
    with PatientController(Inner(), PATIENT_S, PERIOD_S) as patient:
        first = patient.step(0, 0, state())
        patient.step(1, 0, state())
    assert np.all(first.position == 0.0)
