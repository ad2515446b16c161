"""One cycle of both hands over virtual CAN FD buses, from encoding the commands to decoded states of eight modules.

Timed are the driver's `write` (encode, send), the transport of the modules' frames (receive two broadcasts, send
eight states) and the driver's `read` (receive, decode); the modules' own work between them is not. Beside it, in
turns: bare python-can sending and receiving the same ten frames.
"""

from __future__ import annotations

import itertools
import time
from functools import partial

import can
import numpy as np

from preshape.hal.can.bus_address import BusAddress, open_bus
from preshape.hal.can.command_codec import CommandCodec
from preshape.hal.can.device import CanDevice
from preshape.hal.can.identifiers import reply_id, request_id
from preshape.hal.can.parameter_codec import Reply, decode_request, encode_reply
from preshape.hal.can.state_codec import ModuleReport, StateCodec
from preshape.hal.can.topology import TOPOLOGY, BusSpec, Group, Module, Profile, Topology
from preshape.hal.can.vocabulary import FIRMWARE_MAJOR, Answer, ModuleError, ModuleState, Parameter, WireMode
from preshape.hal.can.wire import Wire
from preshape.hal.layout import LAYOUT
from preshape.hal.state import DeviceStatus, Mode, RobotCommand
from preshape.tools.bench_table import Figures

CYCLES = 3000
WARM_UP = 200
PERIOD_NS = 2_000_000

_NUMBERS = itertools.count()


_Frame = tuple[int, bytes | bytearray]
"""Identifier and payload."""


class _Hand:
    """The far end of one hand's bus, answering as its four modules would, through a wire like theirs."""

    def __init__(self, group: Group, bus: can.BusABC, profile: Profile) -> None:
        self.command = CommandCodec(group)
        self.states = tuple((module, StateCodec(module, group)) for module in group.modules)
        self.heard: list[_Frame] = []
        spoken = [self.command.frame_id, *(request_id(module.node) for module in group.modules)]
        self.wire = Wire(bus, profile, {frame_id: partial(self._hear, frame_id) for frame_id in spoken}, {})

    def _hear(self, frame_id: int, payload: bytes | bytearray) -> None:
        self.heard.append((frame_id, payload))

    def answers(self) -> list[_Frame]:
        """Return the frames that answer what has been heard, which is forgotten."""
        heard, self.heard = self.heard, []
        return [answer for frame_id, payload in heard for answer in self._answer(frame_id, payload)]

    def _answer(self, frame_id: int, payload: bytes | bytearray) -> list[_Frame]:
        if frame_id == self.command.frame_id:
            command = self.command.decode(payload)
            assert command is not None
            taken = command.mode is not WireMode.POLL
            return [(codec.frame_id, _state(module, codec, command.sequence, taken)) for module, codec in self.states]
        return [_reply(module, payload) for module, _ in self.states if request_id(module.node) == frame_id]


def _message(frame: _Frame) -> can.Message:
    frame_id, payload = frame
    return can.Message(arbitration_id=frame_id, is_extended_id=False, is_fd=True, bitrate_switch=True, data=payload)


def _state(module: Module, codec: StateCodec, sequence: int, taken: bool) -> bytearray:
    middle = 0.5 * (LAYOUT.lower + LAYOUT.upper)[list(module.indices)]
    nothing = np.zeros(len(module.joints))
    armed = ModuleState.ARMED
    return codec.encode(ModuleReport(sequence, armed, ModuleError.NONE, taken, 30, middle, nothing, nothing))


def _reply(module: Module, payload: bytes | bytearray) -> _Frame:
    """Return the answer to a parameter request: every order is carried out."""
    request = decode_request(request_id(module.node), payload)
    assert request is not None
    value = FIRMWARE_MAJOR << 16 if request.parameter is Parameter.FIRMWARE else request.value
    reply = Reply(Answer.DONE, request.parameter, request.tag, request.joint, value, 1)
    return reply_id(module.node), encode_reply(reply_id(module.node), reply)


class _Bench:
    """A driver of both hands and its far end, on buses of their own."""

    def __init__(self) -> None:
        hands = Topology(tuple(bus for bus in TOPOLOGY.buses if bus.name != "arms"))
        self.addresses = {bus.name: BusAddress("virtual", f"bench-{next(_NUMBERS)}") for bus in hands.buses}
        self.hands = [self._hand(bus) for bus in hands.buses]
        self.device = CanDevice(hands, self._open)
        self.now_ns = 0
        self.frames: list[_Frame] = []

    def _open(self, spec: BusSpec, identifiers: list[int]) -> can.BusABC:
        return open_bus(self.addresses[spec.name], spec.profile)

    def _hand(self, spec: BusSpec) -> _Hand:
        return _Hand(spec.groups[0], open_bus(self.addresses[spec.name], spec.profile), spec.profile)

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
                hand.wire.drain()
                for frame_id, payload in hand.answers():
                    hand.wire.send(frame_id, payload)
            if status is DeviceStatus.ARMED:
                return
        raise RuntimeError(f"bench: the driver is {status.name}, allowed is ARMED")

    def cycle(self, command: RobotCommand) -> float:
        """Return what one cycle takes, us; keeps its frames."""
        clock = time.perf_counter_ns
        self.now_ns += PERIOD_NS
        start = clock()
        taken = self.device.write(command, self.now_ns)
        for hand in self.hands:
            hand.wire.drain()
        spent = clock() - start
        assert taken
        commands = [frame for hand in self.hands for frame in hand.heard]
        answers = [hand.answers() for hand in self.hands]
        start = clock()
        for hand, frames in zip(self.hands, answers, strict=True):
            for frame_id, payload in frames:
                hand.wire.send(frame_id, payload)
        state = self.device.read(self.now_ns + PERIOD_NS)
        spent += clock() - start
        assert state.sequence == command.sequence
        self.frames = commands + [frame for frames in answers for frame in frames]
        return spent * 1e-3

    def close(self) -> None:
        """Close both ends."""
        self.device.close()
        for hand in self.hands:
            hand.wire.close()


def _bare_us(near: can.BusABC, far: can.BusABC, frames: list[_Frame]) -> float:
    """Return what python-can alone needs to send and receive the frames, us."""
    messages = [_message(frame) for frame in frames]
    start = time.perf_counter_ns()
    for message in messages:
        near.send(message)
    for _ in messages:
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
