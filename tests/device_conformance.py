"""The conformance suite of `preshape.hal.device.Device`: every device passes it, simulated or real.

Use it by a subclass whose `open_rig` returns the device and a clock; sleeping on that clock lets time pass
for the device (a lockstep clock steps the physics, a real one waits):

    class TestMyDevice(DeviceConformance):
        def open_rig(self) -> Rig:
            ...
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
import pytest

from preshape.hal.clock import Clock
from preshape.hal.device import Device
from preshape.hal.layout import LAYOUT, SIDES
from preshape.hal.state import DeviceStatus, Mode, RobotCommand, RobotState

FLEXIONS = [
    LAYOUT.index(f"{side}_{finger}_{joint}")
    for side in SIDES
    for finger in ("fore", "middle", "ring")
    for joint in ("flex", "pip")
]
"""Joints that the suite moves in free space: they touch nothing when they bend a little."""


@dataclass
class Rig:
    """A device that is not yet open, and what lets time pass for it."""

    device: Device
    clock: Clock
    period_s: float = 0.002
    sequence: int = field(default=0)

    def read(self) -> RobotState:
        """Read the device now."""
        return self.device.read(self.clock.now_ns())

    def wait(self, seconds: float) -> RobotState:
        """Let time pass without writing, reading every period; return the last state."""
        state = self.read()
        for _ in range(max(1, round(seconds / self.period_s))):
            self.clock.sleep_until_ns(self.clock.now_ns() + round(self.period_s * 1e9))
            state = self.read()
        return state

    def write(self, position: np.ndarray, limit: np.ndarray | None = None, mode: Mode = Mode.POSITION,
              torque: np.ndarray | None = None, sequence: int | None = None) -> bool:  # fmt: skip
        """Write a command, by default the next one in sequence with full torque limits."""
        if sequence is None:
            self.sequence += 1
            sequence = self.sequence
        limit = LAYOUT.torque if limit is None else limit
        torque = np.zeros(LAYOUT.dof) if torque is None else torque
        return self.device.write(RobotCommand(sequence, mode, position, limit, torque), self.clock.now_ns())

    def drive(self, goal: np.ndarray, seconds: float, limit: np.ndarray | None = None) -> RobotState:
        """Write a straight ramp from the measured position to the goal, one command a period."""
        start, steps = self.read().position, max(1, round(seconds / self.period_s))
        state = self.read()
        for k in range(steps):
            self.write(start + (goal - start) * (k + 1) / steps, limit)
            self.clock.sleep_until_ns(self.clock.now_ns() + round(self.period_s * 1e9))
            state = self.read()
        return state

    def arm(self, within_s: float = 2.0) -> RobotState:
        """Arm and wait for ARMED."""
        self.device.arm(self.clock.now_ns())
        state = self.wait(self.period_s)
        for _ in range(round(within_s / self.period_s)):
            if state.status is DeviceStatus.ARMED:
                break
            state = self.wait(self.period_s)
        assert state.status is DeviceStatus.ARMED, state.fault
        return state


class DeviceConformance(ABC):
    """The laws. Tolerances may be widened by a subclass, with its reason."""

    position_tolerance = 0.03
    """How far a joint may be from where it is held or commanded to, rad."""
    drift = 0.02
    """How far a joint may move while nothing moves it, rad."""
    torque_slack = 0.03
    """Noise and quantisation of a measured torque, N m."""
    freshest_s = 0.02
    """How old a sample may be while everything works."""

    @abstractmethod
    def open_rig(self) -> Rig:
        """Return a rig whose device has not been opened."""

    @pytest.fixture
    def rig(self) -> Iterator[Rig]:
        """Open a rig for one test, and close it after."""
        rig = self.open_rig()
        rig.device.open()
        rig.wait(0.05)
        yield rig
        rig.device.close()

    def bent(self, state: RobotState, angle: float) -> np.ndarray:
        """Return the state's position with the suite's joints bent by an angle, within their limits."""
        goal = state.position.copy()
        goal[FLEXIONS] = np.clip(goal[FLEXIONS] + angle, LAYOUT.lower[FLEXIONS], LAYOUT.upper[FLEXIONS])
        return goal

    def test_reports_disarmed_finite_and_fresh_after_opening(self, rig: Rig) -> None:
        state = rig.wait(0.05)
        assert state.status is DeviceStatus.DISARMED
        for values in (state.position, state.velocity, state.torque):
            assert np.isfinite(values).all()
        age = state.age_ns(rig.clock.now_ns())
        assert (age >= 0).all() and age.max() <= self.freshest_s * 1e9

    def test_stamps_move_on_with_time(self, rig: Rig) -> None:
        first = rig.read()
        second = rig.wait(0.05)
        assert (second.stamp_ns > first.stamp_ns).all()

    def test_refuses_every_write_before_it_is_armed(self, rig: Rig) -> None:
        before = rig.read()
        for _ in range(10):
            assert not rig.write(self.bent(before, 0.3))
            rig.wait(rig.period_s)
        assert np.abs(rig.wait(0.2).position - before.position).max() < self.drift

    def test_holds_measured_position_before_first_command(self, rig: Rig) -> None:
        armed = rig.arm()
        assert np.abs(rig.wait(0.02).position - armed.position).max() < self.drift

    def test_goes_where_it_is_commanded_and_echoes_the_sequence(self, rig: Rig) -> None:
        goal = self.bent(rig.arm(), 0.3)
        state = rig.drive(goal, 0.5)
        for _ in range(100):
            rig.write(goal)
            state = rig.wait(rig.period_s)
        assert np.abs(state.position - goal).max() < self.position_tolerance
        assert rig.sequence - 5 <= state.sequence <= rig.sequence

    def test_takes_only_newer_commands(self, rig: Rig) -> None:
        armed = rig.arm()
        assert rig.write(armed.position)
        newest = rig.sequence
        assert not rig.write(self.bent(armed, 0.5), sequence=newest)
        assert not rig.write(self.bent(armed, 0.5), sequence=newest - 1)
        assert rig.write(armed.position, sequence=newest + 1)
        rig.sequence = newest + 1
        assert np.abs(rig.wait(0.02).position - armed.position).max() < self.drift

    def test_no_joint_uses_more_torque_than_its_command_allows(self, rig: Rig) -> None:
        armed = rig.arm()
        limit = LAYOUT.torque.copy()
        limit[FLEXIONS] = 0.2
        goal = self.bent(armed, 0.8)
        for _ in range(100):
            rig.write(goal, limit)
            state = rig.wait(rig.period_s)
            assert np.abs(state.torque[FLEXIONS]).max() <= 1.2 * 0.2 + self.torque_slack

    def test_hold_mode_ignores_the_commanded_position(self, rig: Rig) -> None:
        armed = rig.arm()
        for _ in range(50):
            rig.write(self.bent(armed, 0.5), mode=Mode.HOLD)
            state = rig.wait(rig.period_s)
        assert np.abs(state.position - armed.position).max() < self.drift

    def test_torque_mode_pushes_towards_its_target_and_is_clipped_at_the_limit(self, rig: Rig) -> None:
        armed = rig.arm()
        limit, torque = LAYOUT.torque.copy(), np.zeros(LAYOUT.dof)
        limit[FLEXIONS], torque[FLEXIONS] = 0.1, 5.0
        for _ in range(50):
            rig.write(armed.position, limit, Mode.TORQUE, torque)
            state = rig.wait(rig.period_s)
            assert np.abs(state.torque[FLEXIONS]).max() <= 1.2 * 0.1 + self.torque_slack
            if (state.position - armed.position)[FLEXIONS].max() > 0.3:
                # Before the end stops, however slowly this loop has run.
                break
        assert (state.position[FLEXIONS] > armed.position[FLEXIONS]).all()

    def test_a_stop_is_latched_and_holds_where_it_was_given(self, rig: Rig) -> None:
        armed = rig.arm()
        rig.drive(self.bent(armed, 0.3), 0.3)
        rig.device.stop("test", rig.clock.now_ns())
        stopped = rig.wait(0.1)
        assert stopped.status is DeviceStatus.STOPPED
        for _ in range(20):
            assert not rig.write(armed.position)
            state = rig.wait(rig.period_s)
        assert state.status is DeviceStatus.STOPPED
        assert np.abs(state.position - stopped.position).max() < self.drift

    def test_a_stop_is_taken_in_every_state(self, rig: Rig) -> None:
        for _ in range(2):
            rig.device.stop("test", rig.clock.now_ns())
            assert rig.wait(0.05).status is DeviceStatus.STOPPED
        rig.arm()

    def test_a_command_from_before_a_stop_is_never_executed_after_arming_again(self, rig: Rig) -> None:
        rig.write(rig.arm().position)
        rig.write(self.bent(rig.read(), 0.8))
        rig.device.stop("test", rig.clock.now_ns())
        rig.wait(0.2)
        armed = rig.arm()
        assert np.abs(rig.wait(0.02).position - armed.position).max() < self.drift
        assert rig.write(armed.position)
        goal = self.bent(armed, -0.1)
        state = rig.drive(goal, 0.3)
        assert state.status is DeviceStatus.ARMED
        assert np.abs(rig.drive(goal, 0.2).position - goal).max() < self.position_tolerance

    def test_closing_twice_is_harmless_and_leaves_nothing_moving(self, rig: Rig) -> None:
        rig.drive(self.bent(rig.arm(), 0.2), 0.1)
        rig.device.close()
        rig.device.close()
        assert not rig.write(np.array(rig.read().position) if self.readable_when_closed else LAYOUT.lower)

    readable_when_closed = False
    """Whether `read` still works after `close`; hardware cannot."""
