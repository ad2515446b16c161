"""Laws of replay: recorded inputs give the recorded commands, and whatever differs is found where it begins."""

from __future__ import annotations

import threading
from collections.abc import Callable

import numpy as np
import pytest
from device_conformance import DeviceConformance, Rig
from kinematic_device import KinematicDevice
from manual_clock import ManualClock
from test_loop import Recorder, Sine, Stage

from preshape.control.controller import Setpoint
from preshape.control.loop_result import LoopConfig
from preshape.hal.gate import SafetyGate
from preshape.hal.layout import LAYOUT
from preshape.hal.replay import ReplayDevice
from preshape.hal.state import RobotCommand, RobotState
from preshape.hal.tick_record import TickRecord, new_record, note_state
from preshape.tools.patient import PatientController
from preshape.tools.replay import Replayed, replay_ticks
from preshape.tools.replay_patient import ReplayPatient, paces

LAWS = sorted(name for name in dir(DeviceConformance) if name.startswith("test_"))


class TapedDevice:
    """A device that notes what it answers."""

    def __init__(self, inner: KinematicDevice) -> None:
        self.inner = inner
        self.states: list[RobotState] = []
        self.taken: list[bool] = []
        self.refusals: list[str] = []

    def open(self) -> None:
        self.inner.open()

    def read(self, now_ns: int) -> RobotState:
        self.states.append(self.inner.read(now_ns))
        return self.states[-1]

    def arm(self, now_ns: int) -> None:
        try:
            self.inner.arm(now_ns)
        except RuntimeError as error:
            self.refusals.append(str(error))
            raise
        self.refusals.append("")

    def write(self, command: RobotCommand, now_ns: int) -> bool:
        self.taken.append(self.inner.write(command, now_ns))
        return self.taken[-1]

    def stop(self, reason: str, now_ns: int) -> None:
        self.inner.stop(reason, now_ns)

    def close(self) -> None:
        self.inner.close()


class Suite(DeviceConformance):
    """The conformance suite without a rig of its own."""

    def open_rig(self) -> Rig:
        raise NotImplementedError

    def obey(self, law: str, rig: Rig) -> None:
        rig.device.open()
        rig.wait(0.05)
        getattr(self, law)(rig)
        rig.device.close()


@pytest.mark.parametrize("law", LAWS)
def test_a_recorded_device_obeys_the_laws_that_the_device_obeyed(law: str) -> None:
    device = KinematicDevice()
    taped = TapedDevice(device)
    Suite().obey(law, Rig(taped, ManualClock(device.advance)))
    replayed = ReplayDevice(taped.states, taped.taken, taped.refusals)
    Suite().obey(law, Rig(replayed, ManualClock(lambda step_ns: None)))


def recorded(stage: Stage, controller: Sine) -> TickRecord:
    """Run a controller and return its ticks."""
    stage.run(controller)
    return np.array(stage.recorder.records)


def again(ticks: TickRecord, controller: Sine, config: LoopConfig | None = None) -> Replayed:
    """Replay ticks through a controller."""
    return replay_ticks(ticks, controller, config or LoopConfig(), SafetyGate())


def test_the_same_controller_writes_the_same_commands() -> None:
    ticks = recorded(Stage(), Sine(200))
    result = again(ticks, Sine(200))
    assert result.equal and result.compared == len(ticks)
    assert result.commands == int(ticks["commanded"].sum()) >= 200


def test_a_stop_is_given_in_the_tick_that_knew_of_it() -> None:
    stage = Stage()
    ticks = recorded(stage, Sine(at={45: lambda: stage.loop.request_stop("operator")}))
    result = again(ticks, Sine())
    assert result.equal and ticks["mode"][-1] != b"running"


@pytest.mark.parametrize("tick", [0, 60])
def test_a_fault_of_the_device_is_replayed(tick: int) -> None:
    stage = Stage()
    ticks = recorded(stage, Sine(at={tick: lambda: stage.device.fail("node 3 lost")}))
    assert again(ticks, Sine()).equal


class Shifted(Sine):
    """A controller that differs from `Sine` by one bit in one joint from some tick on."""

    def __init__(self, ticks: int, first: int, joint: str) -> None:
        super().__init__(ticks)
        self.first, self.joint = first, LAYOUT.index(joint)

    def step(self, tick: int, now_ns: int, state: RobotState) -> Setpoint:
        setpoint = super().step(tick, now_ns, state)
        position = setpoint.position.copy()
        if tick >= self.first:
            position[self.joint] = np.nextafter(position[self.joint], 9.0)
        return Setpoint(position, setpoint.torque_limit, setpoint.finished)


def test_a_single_bit_is_found_in_its_tick_and_joint() -> None:
    ticks = recorded(Stage(), Sine(200))
    result = again(ticks, Shifted(200, 77, "left_ring_pip"))
    assert not result.equal and result.difference is not None
    assert result.difference.tick == 77
    assert "left_ring_pip" in result.difference.what and "target" in result.difference.what


def test_a_controller_that_ends_earlier_is_found() -> None:
    ticks = recorded(Stage(), Sine(200))
    result = again(ticks, Sine(150))
    assert not result.equal and "ended" in result.end


def test_a_recording_that_was_cut_off_is_equal_up_to_there() -> None:
    ticks = recorded(Stage(), Sine(200))[:120]
    result = again(ticks, Sine(200))
    assert result.equal and result.ticks == 120


class Thinker:
    """Moves with each of its steps and what it is told to follow; some steps take long."""

    def __init__(self, slow: frozenset[int], wait: Callable[[], None]) -> None:
        self.slow, self.wait = slow, wait
        self.position = np.zeros(LAYOUT.dof)
        self.heard: list[tuple[str, int, float]] = []

    def step(self, tick: int, now_ns: int, state: RobotState) -> Setpoint:
        if tick in self.slow:
            self.wait()
        self.heard.append(("step", now_ns, float(state.position[0])))
        self.position += 0.25 * state.position
        return Setpoint(self.position, LAYOUT.torque)

    def follow(self, position: np.ndarray, velocity: np.ndarray) -> None:
        self.heard.append(("follow", 0, float(position[0])))
        self.position[:] = position

    def note(self, record: TickRecord) -> None:
        """Nothing to say."""


def drive(controller: PatientController | ReplayPatient, ticks: int) -> tuple[list[bytes], TickRecord]:
    """Run so many ticks; return every setpoint's bytes and the records."""
    rng, record, recorder, setpoints = np.random.default_rng(0), new_record(), Recorder(), list[bytes]()
    controller.follow(np.full(LAYOUT.dof, 0.5), np.zeros(LAYOUT.dof))
    for tick in range(ticks):
        state = RobotState(tick, *rng.normal(size=(3, LAYOUT.dof)), np.zeros(LAYOUT.dof, np.int64))
        note_state(record, tick, 1000 * tick, state)
        setpoint = controller.step(tick, 1000 * tick, state)
        setpoints.append(setpoint.position.tobytes() + setpoint.torque_limit.tobytes())
        if tick % 7 == 3:
            controller.follow(np.full(LAYOUT.dof, float(tick)), np.zeros(LAYOUT.dof))
        controller.note(record)
        recorder.notify(record)
    return setpoints, np.array(recorder.records)


def test_ticks_that_held_are_held_again_and_the_thinker_hears_the_same() -> None:
    slow, pause = frozenset({0, 11, 12, 30}), threading.Event()
    thinker = Thinker(slow, lambda: pause.wait(0.03) and None)
    with PatientController(thinker, 0.004, 0.002) as patient:
        setpoints, records = drive(patient, 120)
    assert patient.held > 4 and records["held"].sum() == patient.held
    fresh = Thinker(frozenset(), lambda: None)
    replayed, _ = drive(ReplayPatient(fresh, paces(records), 0.002), 120)
    assert replayed == setpoints
    # The step that was under way when the run ended may or may not have been heard.
    assert fresh.heard[: len(thinker.heard)] == thinker.heard[: len(fresh.heard)]
