"""Laws of the control loop: when it ticks, what it writes, how it ends."""

from __future__ import annotations

import gc
import hashlib
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from kinematic_device import START, KinematicDevice
from manual_clock import ManualClock
from stop_time import assert_stops_in_least_time

from preshape.control.controller import Setpoint
from preshape.control.loop import ControlLoop, next_deadline
from preshape.control.loop_result import LoopConfig, LoopOutcome, LoopResult
from preshape.control.modes import LoopMode
from preshape.hal.gate import SafetyGate
from preshape.hal.gate_config import GateConfig
from preshape.hal.layout import LAYOUT
from preshape.hal.state import DeviceStatus, RobotState
from preshape.hal.tick_record import TickRecord, note_progress, text_of

PERIOD_NS = 2_000_000


class Sine:
    """A controller that swings every joint a little; `at` runs a test's own code in a tick."""

    def __init__(self, ticks: int = 10**9, at: dict[int, Callable[[], None]] | None = None) -> None:
        self.ticks, self.at = ticks, at or {}
        self.seen: list[tuple[int, int]] = []
        self.followed: list[tuple[np.ndarray, np.ndarray]] = []
        self.gc_enabled: bool | None = None

    def step(self, tick: int, now_ns: int, state: RobotState) -> Setpoint:
        self.seen.append((tick, now_ns))
        self.gc_enabled = gc.isenabled()
        self.at.get(tick, lambda: None)()
        position = START + 0.02 * (1.0 - np.cos(0.03 * (tick + 1)))
        return Setpoint(position, 0.5 * LAYOUT.torque, finished=tick + 1 >= self.ticks)

    def follow(self, position: np.ndarray, velocity: np.ndarray) -> None:
        self.followed.append((position.copy(), velocity.copy()))

    def note(self, record: TickRecord) -> None:
        note_progress(record, 3, "swing", "", None)


class Recorder:
    """Keeps every record."""

    def __init__(self) -> None:
        self.records: list[TickRecord] = []

    def notify(self, record: TickRecord) -> None:
        self.records.append(record.copy())


class Stage:
    """Everything a loop needs, in memory."""

    def __init__(self, config: LoopConfig | None = None, gate: GateConfig | None = None) -> None:
        self.device = KinematicDevice()
        self.device.open()
        self.clock = ManualClock(self.device.advance)
        self.gate, self.recorder = SafetyGate(gate), Recorder()
        self.loop = ControlLoop(self.device, self.clock, self.gate, self.recorder, lambda: 0, config)

    def run(self, controller: Sine) -> LoopResult:
        return self.loop.run(controller)


@given(
    deadline=st.integers(0, 10**12), late=st.integers(-(10**7), 10**9), period=st.integers(10**5, 10**8)
)  # fmt: skip
def test_the_next_deadline_is_the_first_of_the_grid_after_now_and_never_bursts(
    deadline: int, late: int, period: int
) -> None:
    now = deadline + late
    after = next_deadline(deadline, now, period)
    assert (after - deadline) % period == 0
    assert after > deadline and after > now
    assert after - max(now, deadline) <= period


def test_ticks_are_one_nominal_period_apart_for_the_controller_however_late_they_come() -> None:
    stage = Stage()
    stall = 7 * PERIOD_NS + 300_000
    controller = Sine(30, at={10: lambda: stage.clock.sleep_until_ns(stage.clock.now_ns() + stall)})
    result = stage.run(controller)
    ticks, times = zip(*controller.seen, strict=True)
    assert ticks == tuple(range(30))
    gaps = np.diff(times)
    assert (gaps[10], gaps[11]) == (stall, 8 * PERIOD_NS - stall)
    assert (np.delete(gaps, [10, 11]) == PERIOD_NS).all()
    assert result.timing.overruns == 1
    assert result.timing.lateness_us.max == pytest.approx((stall - PERIOD_NS) * 1e-3)


def test_the_first_command_is_the_measured_position_and_comes_before_the_first_step() -> None:
    stage = Stage()
    stage.device.position = START + 0.05
    controller = Sine(5)
    stage.run(controller)
    assert np.array_equal(stage.device.written[0].position, START + 0.05)
    ((position, velocity),) = controller.followed
    assert np.array_equal(position, START + 0.05) and not velocity.any()


def test_finishing_ends_the_run_with_the_device_stopped() -> None:
    stage = Stage()
    result = stage.run(Sine(50))
    assert result.outcome is LoopOutcome.FINISHED and result.ticks == 50
    assert stage.device.status is DeviceStatus.STOPPED and stage.loop.mode is LoopMode.STOPPED
    assert not stage.gate.armed


def test_the_run_ends_when_its_ticks_are_over() -> None:
    result = Stage(LoopConfig(max_ticks=20)).run(Sine())
    assert result.outcome is LoopOutcome.TIME_UP and result.ticks == 20


def test_the_digest_is_that_of_all_bytes_written() -> None:
    stage = Stage()
    result = stage.run(Sine(40))
    data = b"".join(c.position.tobytes() + c.torque_limit.tobytes() for c in stage.device.written)
    assert result.commands_sha256 == hashlib.sha256(data).hexdigest()
    assert result.written == len(stage.device.written) == 41


def test_two_runs_of_the_same_thing_write_the_same_bytes() -> None:
    first, second = (Stage().run(Sine(60)).commands_sha256 for _ in range(2))
    other = Stage().run(Sine(61)).commands_sha256
    assert first == second != other


def test_a_requested_stop_comes_to_rest_in_ruckigs_least_time_before_the_device_is_stopped() -> None:
    stage = Stage()
    result = stage.run(Sine(at={45: lambda: stage.loop.request_stop("operator")}))
    assert result.outcome is LoopOutcome.STOPPED and result.reason == "operator"
    positions = np.array([command.position for command in stage.device.written])
    # Tick 45 asks for it, tick 46 knows; command 0 was the measured position, so that of tick 45 is number 46.
    assert_stops_in_least_time(positions[44:], PERIOD_NS * 1e-9)
    assert stage.device.stops == ["operator"]


@pytest.mark.parametrize("tick", [0, 30])
def test_a_device_fault_stops_at_once_with_its_name(tick: int) -> None:
    stage = Stage()
    result = stage.run(Sine(at={tick: lambda: stage.device.fail("node 3 lost")}))
    assert result.outcome is LoopOutcome.SAFETY_STOP
    assert "node 3 lost" in result.reason
    assert result.ticks <= tick + 2
    assert stage.device.stops == [result.reason]


def test_a_setpoint_that_is_not_finite_is_never_written() -> None:
    class Broken(Sine):
        def step(self, tick: int, now_ns: int, state: RobotState) -> Setpoint:
            good = super().step(tick, now_ns, state)
            return (
                Setpoint(np.where(np.arange(40) == 4, np.nan, good.position), good.torque_limit) if tick == 20 else good
            )

    stage = Stage()
    result = stage.run(Broken())
    assert result.outcome is LoopOutcome.SAFETY_STOP and LAYOUT.names[4] in result.reason
    assert all(np.isfinite(command.position).all() for command in stage.device.written)
    assert len(stage.device.written) == 21


def test_stale_samples_end_in_a_safety_stop() -> None:
    stage = Stage()
    result = stage.run(Sine(at={25: lambda: setattr(stage.device, "frozen", True)}))
    assert result.outcome is LoopOutcome.SAFETY_STOP and "stale" in result.reason
    assert result.ticks == 25 + 1 + round(stage.gate.config.stop_age_s * 1e9 / PERIOD_NS)


def test_a_stall_longer_than_the_watchdog_is_a_safety_stop() -> None:
    stage = Stage()
    stall = Sine(at={5: lambda: stage.clock.sleep_until_ns(stage.clock.now_ns() + 300_000_000)})
    result = stage.run(stall)
    assert result.outcome is LoopOutcome.SAFETY_STOP and "watchdog" in result.reason


def test_the_controller_is_told_when_the_gate_has_changed_its_setpoint() -> None:
    class Jump(Sine):
        def step(self, tick: int, now_ns: int, state: RobotState) -> Setpoint:
            good = super().step(tick, now_ns, state)
            return Setpoint(good.position + (2e-3 if tick >= 10 else 0.0), good.torque_limit, tick == 15)

    stage, controller = Stage(), Jump()
    stage.run(controller)
    told = controller.followed[1:]
    assert told
    for (position, velocity), command, before in zip(
        told, stage.device.written[11:], stage.device.written[10:], strict=False
    ):
        assert np.array_equal(position, command.position)
        assert np.allclose(velocity, (command.position - before.position) / (PERIOD_NS * 1e-9))


def test_refused_arming_is_named_and_nothing_is_written() -> None:
    stage = Stage()
    stage.device.refuse_arming = "emergency switch is pressed"
    result = stage.run(Sine())
    assert result.outcome is LoopOutcome.SAFETY_STOP and "emergency switch" in result.reason
    assert not stage.device.written and result.ticks == 0


def test_a_device_that_never_becomes_armed_is_named_in_time() -> None:
    stage = Stage(LoopConfig(arming_s=0.1))
    stage.device.arm = lambda now_ns: None  # type: ignore[method-assign]
    result = stage.run(Sine())
    assert result.outcome is LoopOutcome.SAFETY_STOP and "not armed within 0.1 s" in result.reason
    assert not stage.device.written


def test_commands_refused_in_a_row_are_a_fault() -> None:
    stage = Stage(LoopConfig(refused_ticks=5))
    stage.device.write = lambda command, now_ns: False  # type: ignore[method-assign]
    result = stage.run(Sine())
    assert result.outcome is LoopOutcome.SAFETY_STOP and "refused 5" in result.reason
    assert result.refused == result.written == 5


def test_sequences_go_on_from_what_the_device_has_already_taken() -> None:
    stage = Stage()
    stage.run(Sine(10))
    again = ControlLoop(stage.device, stage.clock, stage.gate, stage.recorder, lambda: 0)
    assert again.run(Sine(10)).refused == 0
    sequences = [command.sequence for command in stage.device.written]
    assert sequences == sorted(set(sequences)) and len(sequences) == 22


def test_an_exception_of_the_controller_stops_the_device_and_goes_on_up() -> None:
    def fail() -> None:
        raise ZeroDivisionError("a bug")

    stage = Stage()
    with pytest.raises(ZeroDivisionError):
        stage.run(Sine(at={12: fail}))
    assert stage.device.status is DeviceStatus.STOPPED and "a bug" in stage.device.stops[-1]
    assert gc.isenabled()


def test_the_collector_rests_during_the_run_and_is_restored() -> None:
    stage, controller = Stage(), Sine(5)
    assert gc.isenabled()
    stage.run(controller)
    assert controller.gc_enabled is False and gc.isenabled() and gc.get_freeze_count() == 0


def test_every_tick_is_recorded_as_it_was() -> None:
    stage = Stage()
    result = stage.run(Sine(30))
    records = stage.recorder.records
    commanded = [record for record in records if record["commanded"]]
    assert len(commanded) == result.written
    for record, command in zip(commanded, stage.device.written, strict=True):
        assert np.array_equal(record["target"], command.position) and record["taken"]
        assert record["command_sequence"] == command.sequence
        assert text_of(record, "phase") == "swing" and record["task"] == 3
    modes = [text_of(record, "mode") for record in records]
    assert modes[0] == "holding" and set(modes[1:]) == {"running", "holding"}


def test_a_stop_is_recorded_from_the_tick_on_that_knew_of_it() -> None:
    stage = Stage()
    stage.run(Sine(at={45: lambda: stage.loop.request_stop("operator")}))
    records = stage.recorder.records
    first = next(k for k, record in enumerate(records) if text_of(record, "stop_reason"))
    assert text_of(records[first], "stop_reason") == "operator"
    assert text_of(records[first - 1], "mode") == "running" and text_of(records[first], "mode") == "stopping"


def test_a_stop_from_before_the_run_arms_nothing() -> None:
    stage = Stage()
    stage.loop.request_stop("not now")
    result = stage.run(Sine())
    assert (result.outcome, result.reason, result.ticks) == (LoopOutcome.STOPPED, "not now", 0)
    assert not stage.device.written and not stage.recorder.records
    assert stage.device.stops == ["not now"] and not stage.gate.armed


def test_a_loop_runs_once_and_its_gate_must_have_its_period() -> None:
    stage = Stage()
    stage.run(Sine(3))
    with pytest.raises(RuntimeError, match="make a new one"):
        stage.run(Sine(3))
    with pytest.raises(ValueError, match="gate period"):
        ControlLoop(stage.device, stage.clock, stage.gate, stage.recorder, lambda: 0, LoopConfig(rate_hz=250.0))


@pytest.mark.parametrize("changes", [{"rate_hz": 0.0}, {"max_ticks": 0}, {"arming_s": -1.0}, {"rate_hz": float("nan")}])
def test_limits_that_make_no_sense_are_refused(changes: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="allowed is > 0"):
        LoopConfig(**changes)  # type: ignore[arg-type]
