"""The CAN driver's own laws: what it takes for a fault, what it says then, and that nothing of before is ever done."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from dataclasses import replace

import can
import numpy as np
import pytest
from can_rig import CanRig
from troubled_bus import TroubledBus

from preshape.hal.can.await_modules import await_modules
from preshape.hal.can.bus_address import open_bus
from preshape.hal.can.bus_health import BusCondition
from preshape.hal.can.command_codec import CommandCodec
from preshape.hal.can.device_config import CanDeviceConfig
from preshape.hal.can.heartbeat_codec import Heartbeat, encode_heartbeat
from preshape.hal.can.identifiers import QUICK_STOP_ID, heartbeat_id
from preshape.hal.can.topology import TOPOLOGY
from preshape.hal.can.vocabulary import FIRMWARE_MAJOR, ModuleError, ModuleState, WireMode
from preshape.hal.device import DeviceUnreachable
from preshape.hal.layout import LAYOUT
from preshape.hal.state import DeviceStatus, Mode, RobotCommand
from preshape.sim_backend.bare_robot import BareRobot
from preshape.sim_backend.module_rack import ModuleRack

RIGHT_FORE = 2
"""Node of the right fore finger's module."""


class TroubledRig(CanRig):
    """A rig whose buses can be told to refuse."""

    def __init__(self) -> None:
        self.buses: dict[str, TroubledBus] = {}
        super().__init__(wrap=self._trouble)

    def _trouble(self, bus: can.BusABC, name: str) -> can.BusABC:
        self.buses[name] = TroubledBus(bus)
        return self.buses[name]


@pytest.fixture
def rig() -> Iterator[TroubledRig]:
    rig = TroubledRig()
    rig.ready()
    yield rig
    rig.close()


def go_on(rig: CanRig, cycles: int) -> DeviceStatus:
    """Command the measured position for some cycles; return the status at the end."""
    position = rig.read().position
    for _ in range(cycles):
        rig.write(position)
        rig.wait(rig.period_s)
    return rig.read().status


def send(rig: CanRig, frame_id: int, payload: bytes | bytearray, name: str = "right_hand") -> None:
    tap = rig.tap(name)
    tap.send(can.Message(arbitration_id=frame_id, is_extended_id=False, is_fd=True, data=payload))
    tap.shutdown()


def test_a_healthy_bus_stays_armed_and_samples_are_at_most_two_cycles_old(rig: TroubledRig) -> None:
    assert go_on(rig, 100) is DeviceStatus.ARMED
    assert rig.read().age_ns(rig.clock.now_ns()).max() <= 4_000_000
    assert not rig.can.counts


def test_one_broadcast_a_group_goes_out_a_cycle_and_one_state_a_module_comes_back(rig: TroubledRig) -> None:
    go_on(rig, 10)
    before = {name: (wire.counts["sent"], wire.counts["received"]) for name, wire in rig.can.wires.items()}
    go_on(rig, 40)
    for spec in TOPOLOGY.buses:
        sent, received = before[spec.name]
        wire = rig.can.wires[spec.name]
        assert wire.counts["sent"] - sent == 40 * len(spec.groups)
        beats = wire.counts["received"] - received - 40 * len(spec.modules)
        assert 0 <= beats <= len(spec.modules)


@pytest.mark.parametrize(
    "refusal",
    [
        can.CanOperationError("Failed to transmit: No buffer space available", errno.ENOBUFS),
        can.CanOperationError("Transmit buffer full"),
    ],
    ids=["with errno 105", "without errno"],
)
def test_a_full_transmit_queue_refuses_the_command_and_is_a_fault_when_it_stays_full(
    rig: TroubledRig, refusal: Exception
) -> None:
    go_on(rig, 5)
    rig.buses["arms"].refusal = refusal
    position = rig.read().position
    assert not rig.write(position)
    rig.buses["arms"].refusal = None
    assert go_on(rig, 3) is DeviceStatus.ARMED
    rig.buses["arms"].refusal = refusal
    rig.wait(rig.period_s)
    for _ in range(rig.can.config.lost_cycles):
        assert not rig.write(position)
    state = rig.read()
    assert state.status is DeviceStatus.FAULT
    assert "transmit queue full" in state.fault


def test_a_bus_that_goes_down_is_a_fault_by_name(rig: TroubledRig) -> None:
    rig.buses["left_hand"].refusal = can.CanOperationError("Failed to transmit: Network is down", errno.ENETDOWN)
    go_on(rig, 1)
    state = rig.read()
    assert state.status is DeviceStatus.FAULT
    assert "bus left_hand" in state.fault and "Network is down" in state.fault


def test_bus_off_is_read_from_error_frames_and_latched_even_if_the_bus_recovers(rig: TroubledRig) -> None:
    rig.buses["right_hand"].tell(0x040)
    rig.buses["right_hand"].tell(0x100)
    state = rig.read()
    assert state.status is DeviceStatus.FAULT and state.fault == "bus right_hand is off or has been"
    assert rig.can.wires["right_hand"].health.condition is BusCondition.ACTIVE
    assert rig.wait(0.1).status is DeviceStatus.FAULT
    rig.arm()


def test_a_bus_that_is_off_cannot_be_armed(rig: TroubledRig) -> None:
    rig.buses["right_hand"].tell(0x040)
    rig.read()
    with pytest.raises(RuntimeError, match="arm: bus right_hand is off"):
        rig.device.arm(rig.clock.now_ns())


@pytest.mark.parametrize(
    ("flags", "condition"),
    [(0x08, BusCondition.WARNING), (0x20, BusCondition.PASSIVE), (0x10, BusCondition.PASSIVE)],
)
def test_warning_and_error_passive_are_known_and_stop_nothing(
    rig: TroubledRig, flags: int, condition: BusCondition
) -> None:
    rig.buses["arms"].tell(0x004, bytes([0, flags, 0, 0, 0, 0, 0, 0]))
    assert go_on(rig, 3) is DeviceStatus.ARMED
    assert rig.can.wires["arms"].health.condition is condition


def test_an_emergency_is_a_fault_that_names_module_and_error(rig: TroubledRig) -> None:
    go_on(rig, 3)
    rig.rack.modules[RIGHT_FORE].fail(rig.clock.now_ns(), ModuleError.OVER_TORQUE)
    rig.wait(0.01)
    state = rig.read()
    assert state.status is DeviceStatus.FAULT
    assert state.fault == "module right_fore (node 2) reports over_torque"
    assert all(module.state is not ModuleState.ARMED for module in rig.rack.modules.values())


def test_another_major_firmware_is_refused_with_both_versions(rig: TroubledRig) -> None:
    rig.device.stop("test", rig.clock.now_ns())
    beat = Heartbeat(ModuleState.STOPPED, ModuleError.NONE, 1, FIRMWARE_MAJOR + 1, 0, 1, 0x5A480002, 0)
    send(rig, heartbeat_id(RIGHT_FORE), encode_heartbeat(RIGHT_FORE, beat))
    rig.read()
    with pytest.raises(RuntimeError, match=r"module right_fore \(node 2\) has firmware 2, allowed is 1"):
        rig.device.arm(rig.clock.now_ns())


def test_two_modules_with_one_node_number_are_a_fault_and_cannot_be_armed(rig: TroubledRig) -> None:
    other = BareRobot(seed=9)
    buses = {spec.name: open_bus(rig.address(spec.name), spec.profile) for spec in TOPOLOGY.buses}
    twins = ModuleRack(TOPOLOGY, other, buses, seed=9)
    for module in twins.modules.values():
        module.parameters.serial += 0x100
    rig.robot.after_step.append(lambda time_ns: other.step())
    position = rig.read().position
    for _ in range(100):
        rig.write(position)
        rig.wait(rig.period_s)
    assert rig.read().status is DeviceStatus.FAULT
    with pytest.raises(RuntimeError, match="is there twice"):
        rig.device.arm(rig.clock.now_ns())
    twins.close()


def test_a_second_controller_is_a_fault(rig: TroubledRig) -> None:
    codec = CommandCodec(TOPOLOGY.groups[0])
    n = len(codec.group.joints)
    payload = codec.new_payload()
    codec.encode(payload, 7, 1, WireMode.POSITION, codec.everything, np.zeros(n), np.zeros(n))
    go_on(rig, 2)
    send(rig, codec.frame_id, payload)
    state = rig.wait(rig.period_s)
    assert state.status is DeviceStatus.FAULT and state.fault == "another controller commands right_hand"


def test_anybodys_quick_stop_stops_everything(rig: TroubledRig) -> None:
    go_on(rig, 2)
    send(rig, QUICK_STOP_ID, b"?")
    rig.wait(0.01)
    assert rig.read().status is DeviceStatus.FAULT
    assert all(module.state is ModuleState.STOPPED for module in rig.rack.modules.values())


def test_after_a_power_cut_none_of_500_queued_commands_is_executed(rig: TroubledRig) -> None:
    go_on(rig, 5)
    goal = rig.read().position + 0.3
    taken = {node: module.counts["taken"] for node, module in rig.rack.modules.items()}
    rig.rack.power_off()
    before = rig.robot.position.copy()
    for _ in range(500):
        assert rig.write(goal)
    rig.rack.power_on()
    rig.wait(0.5)
    for node, module in rig.rack.modules.items():
        assert module.counts["taken"] == taken[node]
        assert module.counts["unarmed"] >= 500
    assert rig.read().status is DeviceStatus.FAULT
    assert np.abs(rig.robot.position - before).max() < 0.01


def test_commands_of_before_a_stop_that_arrive_after_arming_again_are_refused_as_foreign(rig: TroubledRig) -> None:
    go_on(rig, 5)
    spy = rig.tap("right_hand")
    goal = rig.read().position + 0.3
    for _ in range(50):
        rig.write(goal)
    late = [frame for frame in iter(lambda: spy.recv(0.0), None) if frame.arbitration_id == 0x0A0]
    rig.device.stop("test", rig.clock.now_ns())
    rig.wait(0.05)
    rig.arm()
    before = rig.robot.position.copy()
    for frame in late:
        spy.send(frame)
    rig.wait(0.05)
    for module in list(rig.rack.modules.values())[:4]:
        assert module.counts["foreign"] == len(late) == 50
    assert np.abs(rig.robot.position - before).max() < 0.01
    spy.shutdown()


def test_an_arming_order_of_before_a_stop_arms_nothing(rig: TroubledRig) -> None:
    spy = rig.tap("right_hand")
    rig.device.stop("test", rig.clock.now_ns())
    rig.wait(0.02)
    rig.arm()
    orders = [frame for frame in iter(lambda: spy.recv(0.0), None) if frame.arbitration_id == 0x600 + RIGHT_FORE]
    assert orders
    rig.device.stop("test", rig.clock.now_ns())
    rig.wait(0.02)
    for frame in orders:
        spy.send(frame)
    rig.clock.sleep_until_ns(rig.clock.now_ns() + 10_000_000)
    assert rig.rack.modules[RIGHT_FORE].state is ModuleState.STOPPED
    spy.shutdown()


def test_the_first_command_of_a_session_equals_the_measured_position_within_a_count(rig: TroubledRig) -> None:
    measured = rig.read().position
    spies = {spec.name: rig.tap(spec.name) for spec in TOPOLOGY.buses}
    assert rig.write(measured)
    for spec in TOPOLOGY.buses:
        frames = [frame for frame in iter(lambda tap=spies[spec.name]: tap.recv(0.0), None)]
        for group in spec.groups:
            codec = CommandCodec(group)
            command = next(filter(None, (codec.decode(f.data) for f in frames if f.arbitration_id == codec.frame_id)))
            assert np.abs(command.target - measured[list(group.indices)]).max() <= group.scale.position
    for spy in spies.values():
        spy.shutdown()


def test_no_torque_limit_on_the_wire_exceeds_the_joints_own(rig: TroubledRig) -> None:
    spy = rig.tap("arms")
    rig.write(rig.read().position, 10.0 * LAYOUT.torque)
    codecs = {codec.frame_id: codec for codec in map(CommandCodec, TOPOLOGY.groups)}
    frames = [frame for frame in iter(lambda: spy.recv(0.0), None) if frame.arbitration_id in codecs]
    assert frames
    for frame in frames:
        codec = codecs[frame.arbitration_id]
        command = codec.decode(frame.data)
        assert command is not None
        assert (command.torque_limit <= LAYOUT.torque[list(codec.group.indices)] + 1e-9).all()
    spy.shutdown()


def test_a_dead_bus_is_polled_seldom_so_that_nothing_piles_up() -> None:
    rig = TroubledRig()
    rig.rack.power_off()
    rig.device.open()
    rig.wait(2.0)
    assert all(bus.sent <= 2 * (rig.can.config.lost_cycles + 1 + 20) for bus in rig.buses.values())
    assert len(rig.can.missing) == len(TOPOLOGY.modules)
    with pytest.raises(RuntimeError, match=r"module right_thumb \(node 1\) has not answered"):
        rig.device.arm(rig.clock.now_ns())
    rig.close()


def test_modules_that_do_not_answer_are_named_with_what_to_do() -> None:
    rig = TroubledRig()
    rig.rack.modules[RIGHT_FORE].power_off()
    rig.device.open()
    with pytest.raises(DeviceUnreachable, match=r"no answer within 0.1 s from right_fore: check power.*hand-bus"):
        await_modules(rig.can, rig.clock, 0.1)
    rig.close()


def test_a_quick_stop_that_was_lost_is_repeated_until_no_module_is_armed(rig: TroubledRig) -> None:
    go_on(rig, 2)
    for bus in rig.buses.values():
        bus.refusal = can.CanOperationError("Transmit buffer full")
    rig.device.stop("test", rig.clock.now_ns())
    for bus in rig.buses.values():
        bus.refusal = None
    assert all(module.state is ModuleState.ARMED for module in rig.rack.modules.values())
    rig.wait(0.01)
    assert all(module.state is ModuleState.STOPPED for module in rig.rack.modules.values())


def test_values_that_are_no_numbers_are_never_sent(rig: TroubledRig) -> None:
    position = rig.read().position
    sent = rig.buses["arms"].sent
    for bad in (np.nan, np.inf):
        spoiled = np.array(position)
        spoiled[3] = bad
        assert not rig.device.write(RobotCommand(10, Mode.POSITION, spoiled, LAYOUT.torque), rig.clock.now_ns())
        assert not rig.device.write(RobotCommand(10, Mode.POSITION, position, spoiled), rig.clock.now_ns())
    assert rig.buses["arms"].sent == sent


def test_closing_stops_the_modules_and_sends_nothing_after(rig: TroubledRig) -> None:
    go_on(rig, 3)
    spy = rig.tap("right_hand")
    rig.device.close()
    frames = list(iter(lambda: spy.recv(0.0), None))
    assert [frame.arbitration_id for frame in frames] == [QUICK_STOP_ID]
    rig.clock.sleep_until_ns(rig.clock.now_ns() + 10_000_000)
    assert all(module.state is ModuleState.STOPPED for module in rig.rack.modules.values())
    rig.read()
    assert all(frame.arbitration_id != 0x0A0 for frame in iter(lambda: spy.recv(0.0), None))
    spy.shutdown()


def test_a_bus_that_cannot_be_opened_leaves_none_open() -> None:
    rig = TroubledRig()
    opened: list[TroubledBus] = []

    def wrap(bus: can.BusABC, name: str) -> can.BusABC:
        if name == "arms":
            bus.shutdown()
            raise DeviceUnreachable("no such bus")
        opened.append(TroubledBus(bus))
        return opened[-1]

    rig.wrap = wrap
    with pytest.raises(DeviceUnreachable, match="no such bus"):
        rig.device.open()
    assert [bus._is_shutdown for bus in opened] == [True, True]
    rig.close()


def test_patience_must_be_positive() -> None:
    with pytest.raises(ValueError, match="lost_cycles: got 0, allowed is > 0"):
        CanDeviceConfig(lost_cycles=0)
    assert replace(CanDeviceConfig(), lost_cycles=1).lost_cycles == 1
