"""The simulated joint modules' firmware: watchdog, modes, parameters, heartbeat, keys, power, in module time."""

from __future__ import annotations

from collections.abc import Iterator

import can
import numpy as np
import pytest
from can_rig import CanRig

from preshape.hal.can.command_codec import CommandCodec
from preshape.hal.can.heartbeat_codec import decode_heartbeat
from preshape.hal.can.identifiers import emergency_id, heartbeat_id, reply_id, request_id, state_id
from preshape.hal.can.parameter_codec import Reply, Request, decode_reply, encode_request
from preshape.hal.can.state_codec import StateCodec
from preshape.hal.can.topology import TOPOLOGY
from preshape.hal.can.vocabulary import Answer, ModuleError, ModuleState, Operation, Parameter, WireMode
from preshape.hal.layout import LAYOUT
from preshape.sim_backend.module_parameters import FIRMWARE_VERSION, SERIAL_BASE

NODE = 2
"""The right fore finger's module: joints 4 to 6 of its group."""
GROUP = TOPOLOGY.groups[0]
CODEC = CommandCodec(GROUP)
STATE = StateCodec(GROUP.modules[1], GROUP)
JOINTS = list(GROUP.modules[1].indices)
MS = 1_000_000


class Bench(CanRig):
    """Modules without a driver: the test speaks to one of them itself."""

    def __init__(self) -> None:
        super().__init__()
        self.line = self.tap("right_hand")
        self.module = self.rack.modules[NODE]
        self.session, self.next = 77, 0
        self.robot.step(2)

    def ask(self, request: Request) -> Reply:
        """Send a request and return its reply."""
        self.hear()
        self.say(request_id(NODE), encode_request(request_id(NODE), request))
        self.robot.step(2)
        payload = next(frame.data for frame in self.hear() if frame.arbitration_id == reply_id(NODE))
        reply = decode_reply(reply_id(NODE), payload)
        assert reply is not None and reply.tag == request.tag
        return reply

    def arm_it(self) -> None:
        key = self.ask(Request(Operation.READ, Parameter.KEY, 1)).key
        order = Request(Operation.WRITE, Parameter.SESSION, 2, value=self.session, key=key)
        assert self.ask(order).answer is Answer.DONE

    def command(self, target: np.ndarray, limit: float = 1.0, mode: WireMode = WireMode.POSITION,
                enable: int | None = None, session: int | None = None) -> None:  # fmt: skip
        """Command the fore finger's joints (3,), and let a period pass; the others of the group get zero."""
        self.send_command(target, limit, mode, enable, session)
        self.robot.step(2)

    def send_command(self, target: np.ndarray, limit: float = 1.0, mode: WireMode = WireMode.POSITION,
                     enable: int | None = None, session: int | None = None) -> None:  # fmt: skip
        self.next += 1
        targets, payload = np.zeros(13), CODEC.new_payload()
        targets[4:7] = target
        enable = CODEC.everything if enable is None else enable
        session = self.session if session is None else session
        CODEC.encode(payload, session, self.next, mode, enable, targets, np.full(13, limit))
        self.say(CODEC.frame_id, payload)

    def say(self, frame_id: int, payload: bytes | bytearray) -> None:
        self.line.send(can.Message(arbitration_id=frame_id, is_extended_id=False, is_fd=True, data=payload))

    def hear(self) -> list[can.Message]:
        return list(iter(lambda: self.line.recv(0.0), None))

    @property
    def position(self) -> np.ndarray:
        return self.robot.position[JOINTS].copy()


@pytest.fixture
def bench() -> Iterator[Bench]:
    bench = Bench()
    yield bench
    bench.line.shutdown()
    bench.close()


def test_a_command_that_enables_no_joint_moves_none_and_is_one_all_the_same(bench: Bench) -> None:
    bench.arm_it()
    held = bench.position
    for _ in range(20):
        bench.command(held + 0.3, enable=0)
    assert np.abs(bench.position - held).max() < 0.01
    assert bench.module.state is ModuleState.ARMED and bench.module.counts["taken"] == 20


def test_five_missed_cycles_make_an_armed_module_hold_and_say_so_until_it_is_armed_again(bench: Bench) -> None:
    bench.arm_it()
    start = bench.position
    bench.command(start + 0.2)
    commanded_ns = bench.robot.time_ns - 2 * MS
    bench.hear()
    bench.robot.step(30)
    assert bench.module.state is ModuleState.FAULT and bench.module.error is ModuleError.WATCHDOG
    event = bench.module.events[-1]
    assert 10 * MS < event.time_ns - commanded_ns <= 12 * MS
    assert [frame.arbitration_id for frame in bench.hear()].count(emergency_id(NODE)) == 1
    bench.robot.step(150)
    held = bench.position
    bench.robot.step(200)
    assert np.abs(bench.position - held).max() < 0.01
    bench.command(start + 0.5)
    assert bench.module.counts["unarmed"] == 1
    bench.arm_it()
    assert bench.module.state is ModuleState.ARMED and bench.module.error is ModuleError.NONE


def test_an_armed_module_waits_for_its_first_command_but_not_for_ever(bench: Bench) -> None:
    bench.arm_it()
    bench.robot.step(900)
    assert bench.module.state is ModuleState.ARMED
    bench.robot.step(200)
    assert bench.module.state is ModuleState.FAULT and bench.module.error is ModuleError.WATCHDOG


@pytest.mark.parametrize("mode", [None, WireMode.HOLD])
def test_whatever_holds_holds_within_the_torque_limit_that_was_set_and_commanded(
    bench: Bench, mode: WireMode | None
) -> None:
    for joint in range(len(JOINTS)):
        order = Request(Operation.WRITE, Parameter.TORQUE_LIMIT, 1, joint=joint, value=0.05)
        assert bench.ask(order).answer is Answer.DONE
    bench.arm_it()
    limit = 0.05
    if mode is not None:
        bench.command(bench.position, 1.0, mode)
        limit = 0.02
        bench.command(bench.position, limit, mode)
    assert bench.robot.model.actuator_forcerange[JOINTS, 1] == pytest.approx(limit, abs=1e-4)


def test_a_hold_that_goes_on_stays_where_it_began(bench: Bench) -> None:
    bench.arm_it()
    bench.command(bench.position, 1.0, WireMode.HOLD)
    held = bench.robot.data.ctrl[JOINTS].copy()
    bench.robot.data.qvel[:] = 0.3
    bench.command(bench.position, 0.5, WireMode.HOLD)
    assert np.array_equal(bench.robot.data.ctrl[JOINTS], held)


def test_every_broadcast_is_answered_once_with_its_sequence(bench: Bench) -> None:
    bench.arm_it()
    bench.hear()
    for _ in range(5):
        bench.command(bench.position)
    states = [STATE.decode(frame.data) for frame in bench.hear() if frame.arbitration_id == state_id(NODE)]
    assert [state.sequence for state in states if state] == [1, 2, 3, 4, 5]
    assert all(state.taken and state.state is ModuleState.ARMED for state in states if state)


def test_commands_of_another_session_or_an_old_sequence_are_refused(bench: Bench) -> None:
    bench.arm_it()
    start = bench.position
    bench.command(start, session=78)
    bench.command(start)
    bench.next -= 2
    bench.command(start + 0.5)
    assert bench.module.counts["foreign"] == 1 and bench.module.counts["late"] == 1
    assert np.abs(bench.position - start).max() < 0.01


def test_commands_that_arrive_unevenly_move_the_target_evenly(bench: Bench) -> None:
    bench.arm_it()
    start, targets = bench.position, list[float]()
    bench.robot.after_step.append(lambda _: targets.append(bench.robot.drives.targets[JOINTS[0]]))
    late = (0, 1, 0, 0, 1, 1, 0, 1, 0, 1, 0, 0)
    for step in range(2 * len(late)):
        number, after = divmod(step, 2)
        if late[number] == after:
            bench.send_command(start + 0.001 * (number + 1))
        bench.robot.step(1)
    # From the second command on, the first late one, every step moves the target by half a command's way.
    np.testing.assert_allclose(np.diff(targets)[3:-2], 0.0005, atol=5e-5)


@pytest.mark.parametrize("cut", ["quick stop", "power"])
def test_a_command_that_waits_when_the_module_stops_is_never_executed(bench: Bench, cut: str) -> None:
    bench.arm_it()
    start = bench.position
    bench.send_command(start)
    bench.robot.step(1)
    bench.send_command(start + 0.5)
    bench.robot.step(1)  # half a period early: it waits
    assert bench.module.counts["taken"] == 2
    if cut == "quick stop":
        bench.module.receive_quick_stop(bench.robot.time_ns)
    else:
        bench.module.power_off()
    bench.robot.step(200)
    assert np.abs(bench.position - start).max() < 0.01


def test_a_joint_that_is_not_enabled_stays(bench: Bench) -> None:
    bench.arm_it()
    start = bench.position
    for _ in range(100):
        bench.command(start + 0.2, enable=CODEC.everything & ~(1 << 5))
    moved = bench.position - start
    assert abs(moved[1]) < 0.01 and moved[2] > 0.1


def test_narrowed_limits_bind_targets_and_torques(bench: Bench) -> None:
    start = bench.position
    upper = Request(Operation.WRITE, Parameter.UPPER_LIMIT, 3, joint=1, value=float(start[1] + 0.1))
    torque = Request(Operation.WRITE, Parameter.TORQUE_LIMIT, 4, joint=2, value=0.05)
    assert bench.ask(upper).answer is Answer.DONE and bench.ask(torque).answer is Answer.DONE
    bench.arm_it()
    for _ in range(150):
        bench.command(start + np.array([0.0, 0.5, 0.1]))
    assert bench.position[1] - start[1] == pytest.approx(0.1, abs=0.02)
    index = bench.robot.model.actuator(LAYOUT.names[JOINTS[2]]).id
    assert bench.robot.model.actuator_forcerange[index] == pytest.approx([-0.05, 0.05])


def test_limits_can_be_narrowed_and_never_widened(bench: Bench) -> None:
    wide = Request(Operation.WRITE, Parameter.TORQUE_LIMIT, 1, joint=0, value=float(LAYOUT.torque[JOINTS[0]] + 0.1))
    assert bench.ask(wide).answer is Answer.OUT_OF_RANGE
    no_number = Request(Operation.WRITE, Parameter.STIFFNESS, 2, joint=0, value=float("nan"))
    assert bench.ask(no_number).answer is Answer.OUT_OF_RANGE


def test_gains_are_set_and_read_and_an_offset_moves_the_reported_torque(bench: Bench) -> None:
    assert bench.ask(Request(Operation.WRITE, Parameter.STIFFNESS, 1, joint=1, value=12.5)).value == 12.5
    assert bench.ask(Request(Operation.READ, Parameter.STIFFNESS, 2, joint=1)).value == 12.5
    assert bench.ask(Request(Operation.READ, Parameter.STIFFNESS, 3, joint=0)).value != 12.5
    bench.ask(Request(Operation.WRITE, Parameter.TORQUE_OFFSET, 4, joint=0, value=0.5))
    bench.hear()
    bench.command(bench.position, mode=WireMode.POLL, session=0)
    payload = next(frame.data for frame in bench.hear() if frame.arbitration_id == state_id(NODE))
    state = STATE.decode(payload)
    assert state is not None and state.torque[0] == pytest.approx(0.5, abs=0.05)


@pytest.mark.parametrize(
    ("parameter", "joint", "answer"),
    [
        (Parameter.FIRMWARE, 255, Answer.READ_ONLY),
        (Parameter.KEY, 255, Answer.READ_ONLY),
        (Parameter.DAMPING, 3, Answer.UNKNOWN_JOINT),
        (Parameter.CYCLE_US, 255, Answer.OUT_OF_RANGE),
    ],
)
def test_what_cannot_be_set_is_refused_by_name(bench: Bench, parameter: Parameter, joint: int, answer: Answer) -> None:
    assert bench.ask(Request(Operation.WRITE, parameter, 9, joint=joint, value=1)).answer is answer


def test_nothing_but_the_session_is_set_while_armed(bench: Bench) -> None:
    bench.arm_it()
    assert bench.ask(Request(Operation.WRITE, Parameter.CYCLE_US, 1, value=2000)).answer is Answer.NOT_NOW


def test_a_wrong_key_arms_nothing_and_brings_the_present_one(bench: Bench) -> None:
    reply = bench.ask(Request(Operation.WRITE, Parameter.SESSION, 1, value=5, key=123))
    assert reply.answer is Answer.WRONG_KEY and bench.module.state is ModuleState.DISARMED
    assert bench.ask(Request(Operation.WRITE, Parameter.SESSION, 2, value=5, key=reply.key)).answer is Answer.DONE


def test_the_key_changes_with_every_stop_and_every_start(bench: Bench) -> None:
    keys = [bench.ask(Request(Operation.READ, Parameter.KEY, 1)).key]
    for change in (
        lambda: bench.say(0x001, b""),
        lambda: bench.module.power_on(bench.robot.time_ns),
        lambda: bench.module.fail(bench.robot.time_ns, ModuleError.DRIVE),
    ):
        bench.arm_it()
        change()
        bench.robot.step(2)
        keys.append(bench.ask(Request(Operation.READ, Parameter.KEY, 1)).key)
    assert len(set(keys)) == len(keys)


def test_it_says_who_it_is(bench: Bench) -> None:
    assert bench.ask(Request(Operation.READ, Parameter.FIRMWARE, 1)).value == FIRMWARE_VERSION
    assert bench.ask(Request(Operation.READ, Parameter.SERIAL, 2)).value == SERIAL_BASE + NODE
    assert bench.ask(Request(Operation.READ, Parameter.ACTUATORS, 3)).value == 3


def test_its_heart_beats_ten_times_a_second_and_counts_its_starts(bench: Bench) -> None:
    bench.hear()
    bench.robot.step(1000)
    beats = [frame for frame in bench.hear() if frame.arbitration_id == heartbeat_id(NODE)]
    assert len(beats) in (9, 10, 11)
    bench.module.power_off()
    bench.robot.step(300)
    assert not [frame for frame in bench.hear() if frame.arbitration_id == heartbeat_id(NODE)]
    bench.module.power_on(bench.robot.time_ns)
    bench.robot.step(5)
    frame = next(frame for frame in bench.hear() if frame.arbitration_id == heartbeat_id(NODE))
    beat = decode_heartbeat(NODE, frame.data)
    assert beat is not None and beat.boots == 2 and beat.state is ModuleState.DISARMED


def test_without_power_its_joints_are_braked_and_it_hears_nothing(bench: Bench) -> None:
    bench.arm_it()
    bench.module.power_off()
    start = bench.position
    for _ in range(50):
        bench.command(start + 0.3)
    assert np.abs(bench.position - start).max() < 0.01
    assert not bench.module.counts["taken"]


def test_too_hot_a_winding_is_a_fault_that_forbids_arming(bench: Bench) -> None:
    bench.arm_it()
    bench.module._temperature_degc = 90.0
    bench.robot.step(200)
    assert bench.module.state is ModuleState.FAULT and bench.module.error is ModuleError.OVER_TEMPERATURE
    key = bench.ask(Request(Operation.READ, Parameter.KEY, 1)).key
    order = Request(Operation.WRITE, Parameter.SESSION, 2, value=5, key=key)
    assert bench.ask(order).answer is Answer.NOT_NOW
