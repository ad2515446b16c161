"""One cycle of both hands over virtual CAN FD buses, from encoding the commands to decoded states of eight modules.

Timed are the driver's `write` (encode, send), the transport of the modules' frames (receive two broadcasts, send
eight states) and the driver's `read` (receive, decode); the modules' own work between them is not. Beside it, in
turns: bare python-can sending and receiving the same ten frames.
"""

from __future__ import annotations

import itertools
import time
from dataclasses import dataclass

import can
import numpy as np

from preshape.hal.can.bus_address import BusAddress, open_bus
from preshape.hal.can.command_codec import CommandCodec
from preshape.hal.can.device import CanDevice
from preshape.hal.can.identifiers import reply_id, request_id
from preshape.hal.can.parameter_codec import Reply, decode_request, encode_reply
from preshape.hal.can.state_codec import ModuleReport, StateCodec
from preshape.hal.can.topology import TOPOLOGY, BusSpec, Group, Module, Topology
from preshape.hal.can.vocabulary import FIRMWARE_MAJOR, Answer, ModuleError, ModuleState, Parameter, WireMode
from preshape.hal.layout import LAYOUT
from preshape.hal.state import DeviceStatus, Mode, RobotCommand
from preshape.tools.bench_table import Figures

CYCLES = 3000
WARM_UP = 200
PERIOD_NS = 2_000_000

_NUMBERS = itertools.count()


@dataclass(frozen=True, slots=True, eq=False)
class _Hand:
    """The far end of one hand's bus, answering as its four modules would."""

    group: Group
    bus: can.BusABC
    command: CommandCodec
    states: tuple[tuple[Module, StateCodec], ...]

    def answer(self, message: can.Message) -> list[can.Message]:
        """Return the frames that answer a frame of the driver's."""
        if message.arbitration_id == self.command.frame_id:
            command = self.command.decode(message.data)
            assert command is not None
            taken = command.mode is not WireMode.POLL
            return [
                _frame(codec.frame_id, _state(module, codec, command.sequence, taken)) for module, codec in self.states
            ]
        return [answer for module, _ in self.states if (answer := _reply(module, message)) is not None]


def _frame(frame_id: int, payload: bytearray) -> can.Message:
    return can.Message(arbitration_id=frame_id, is_extended_id=False, is_fd=True, bitrate_switch=True, data=payload)


def _state(module: Module, codec: StateCodec, sequence: int, taken: bool) -> bytearray:
    middle = 0.5 * (LAYOUT.lower + LAYOUT.upper)[list(module.indices)]
    nothing = np.zeros(len(module.joints))
    armed = ModuleState.ARMED
    return codec.encode(ModuleReport(sequence, armed, ModuleError.NONE, taken, 30, middle, nothing, nothing))


def _reply(module: Module, message: can.Message) -> can.Message | None:
    """Return the answer to a parameter request: every order is carried out."""
    if message.arbitration_id != request_id(module.node):
        return None
    request = decode_request(message.arbitration_id, message.data)
    assert request is not None
    value = FIRMWARE_MAJOR << 16 if request.parameter is Parameter.FIRMWARE else request.value
    reply = Reply(Answer.DONE, request.parameter, request.tag, request.joint, value, 1)
    return _frame(reply_id(module.node), encode_reply(reply_id(module.node), reply))


class _Bench:
    """A driver of both hands and its far end, on buses of their own."""

    def __init__(self) -> None:
        hands = Topology(tuple(bus for bus in TOPOLOGY.buses if bus.name != "arms"))
        self.addresses = {bus.name: BusAddress("virtual", f"bench-{next(_NUMBERS)}") for bus in hands.buses}
        self.hands = [self._hand(bus) for bus in hands.buses]
        self.device = CanDevice(hands, self._open)
        self.now_ns = 0
        self.frames: list[can.Message] = []

    def _open(self, spec: BusSpec, identifiers: list[int]) -> can.BusABC:
        return open_bus(self.addresses[spec.name], spec.profile)

    def _hand(self, spec: BusSpec) -> _Hand:
        group = spec.groups[0]
        states = tuple((module, StateCodec(module, group)) for module in group.modules)
        return _Hand(group, open_bus(self.addresses[spec.name], spec.profile), CommandCodec(group), states)

    def arm(self) -> None:
        """Bring the driver to ARMED, with nothing left on the buses."""
        self.device.open()
        status = DeviceStatus.DISARMED
        for turn in range(50):
            self.now_ns += PERIOD_NS
            status = self.device.read(self.now_ns).status
            if turn == 2:
                self.device.arm(self.now_ns)
            for hand in self.hands:
                while (message := hand.bus.recv(0.0)) is not None:
                    for answer in hand.answer(message):
                        hand.bus.send(answer)
            if status is DeviceStatus.ARMED:
                return
        raise RuntimeError(f"bench: the driver is {status.name}, allowed is ARMED")

    def cycle(self, command: RobotCommand) -> float:
        """Return what one cycle takes, us; keeps its frames."""
        clock = time.perf_counter_ns
        self.now_ns += PERIOD_NS
        start = clock()
        taken = self.device.write(command, self.now_ns)
        received = [hand.bus.recv(0.0) for hand in self.hands]
        spent = clock() - start
        assert taken
        answers = [hand.answer(message) for hand, message in zip(self.hands, received, strict=True) if message]
        start = clock()
        for hand, frames in zip(self.hands, answers, strict=True):
            for frame in frames:
                hand.bus.send(frame)
        state = self.device.read(self.now_ns + PERIOD_NS)
        spent += clock() - start
        assert state.sequence == command.sequence
        self.frames = [message for message in received if message] + [frame for frames in answers for frame in frames]
        return spent * 1e-3

    def close(self) -> None:
        """Close both ends."""
        self.device.close()
        for hand in self.hands:
            hand.bus.shutdown()


def _bare_us(near: can.BusABC, far: can.BusABC, frames: list[can.Message]) -> float:
    """Return what python-can alone needs to send and receive the frames, us."""
    start = time.perf_counter_ns()
    for frame in frames:
        near.send(frame)
    for _ in frames:
        far.recv(0.0)
    return (time.perf_counter_ns() - start) * 1e-3


def bench_bus() -> Figures:
    """Return the cost of a cycle beside that of bare python-can."""
    bench = _Bench()
    address = BusAddress("virtual", f"bench-{next(_NUMBERS)}")
    near, far = open_bus(address, "fd"), open_bus(address, "fd")
    position, limit = 0.5 * (LAYOUT.lower + LAYOUT.upper), LAYOUT.torque
    cycles: list[float] = []
    bare: list[float] = []
    try:
        bench.arm()
        for number in range(WARM_UP + CYCLES):
            cycles.append(bench.cycle(RobotCommand(number, Mode.POSITION, position, limit)))
            bare.append(_bare_us(near, far, bench.frames))
    finally:
        bench.close()
        near.shutdown()
        far.shutdown()
    ours, theirs = np.array(cycles[WARM_UP:]), np.array(bare[WARM_UP:])
    return {
        "cycle_us": float(np.median(ours)),
        "cycle_p99_us": float(np.percentile(ours, 99)),
        "bare_python_can_us": float(np.median(theirs)),
        "cycle_over_bare": float(np.median(ours) / np.median(theirs)),
    }
