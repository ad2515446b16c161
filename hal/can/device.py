"""The joint modules on CAN buses as a `Device`: one owner of every bus, which never waits and never repeats itself."""

from __future__ import annotations

import math
import secrets
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

import can
import numpy as np

from preshape.hal.can.arming import Arming
from preshape.hal.can.bus_health import BusCondition
from preshape.hal.can.command_codec import SEQUENCES, CommandCodec
from preshape.hal.can.command_counts import CommandCounts
from preshape.hal.can.device_config import CanDeviceConfig
from preshape.hal.can.identifiers import QUICK_STOP_ID, request_id
from preshape.hal.can.inbox import Inbox
from preshape.hal.can.parameter_codec import encode_request
from preshape.hal.can.quick_stop_codec import HOST, QuickStop, StopReason, encode_quick_stop
from preshape.hal.can.topology import BusSpec, Topology
from preshape.hal.can.vocabulary import ModuleState, WireMode
from preshape.hal.can.wire import SendStatus, Wire
from preshape.hal.layout import LAYOUT
from preshape.hal.state import DeviceStatus, Mode, RobotCommand, RobotState, Vector

OpenBus = Callable[[BusSpec, list[int]], can.BusABC]
"""Opens one bus, for frames of the given identifiers if it can filter; raises `DeviceUnreachable`."""

_NO_COMMAND = -1
_POLL_SHARE, _COMMAND_SHARE = 0.9, 1.5
"""A poll is due after this share of a period since a poll, for the loop's ticks are not exactly one period apart, and
of one since a command: the next command comes later in the tick, and is itself the request to report."""


def draw_word() -> int:
    """Return a random 32-bit number that nobody could have queued before."""
    return secrets.randbits(32)


@dataclass(frozen=True, slots=True, eq=False)
class _Output:
    """One group's broadcasts: where they are encoded, which of all groups' counts are its own, and its bus."""

    codec: CommandCodec
    payload: bytearray
    own: slice
    wire: Wire


class CanDevice:
    """`preshape.hal.device.Device` of the modules of a topology.

    Every broadcast, command or poll, is answered by every module of its group with its state. A sample's stamp is
    the time at which the broadcast that it answers was sent: the sample is at least as fresh, and a state that
    waited in a queue is as old as it is. Joints that are on no module stay at NaN and age.

    A module that is lost, faulty, stopped by itself, there twice or has started anew, and a bus that was off, is
    down or takes nothing: each leads to FAULT, and to a quick stop on every bus in the same call. A quick stop is
    repeated as long as a module says that it is armed and nobody has armed it. Commands of a session end with it:
    `arm` draws a new one, and modules take no other (see `preshape.hal.can.arming`).
    """

    def __init__(
        self,
        topology: Topology,
        open_bus: OpenBus,
        config: CanDeviceConfig | None = None,
        draw: Callable[[], int] = draw_word,
    ) -> None:
        """Drive a topology's modules over buses that `open_bus` opens; `draw` gives 32-bit numbers for sessions."""
        self.config = config or CanDeviceConfig()
        self._topology, self._open_bus, self._draw = topology, open_bus, draw
        self._inbox = Inbox(topology)
        self._wires: dict[str, Wire] = {}
        self._wire_of: dict[int, Wire] = {}
        self._outputs: list[_Output] = []
        self._status, self._fault = DeviceStatus.DISARMED, ""
        self._session = 0
        self._armed_since = 0
        self._sequence = -1
        self._sent_ns: int | None = None
        self._untaken = 0
        self._tag = 0
        groups = [(group.indices, group.scale) for group in topology.groups]
        self._counts = CommandCounts(groups, LAYOUT.dof, LAYOUT.torque)
        self._nothing = np.zeros(LAYOUT.dof)

    @property
    def wires(self) -> Mapping[str, Wire]:
        """The buses by name, for their counts and health; empty when closed."""
        return self._wires

    @property
    def counts(self) -> Mapping[str, int]:
        """Frames of known identifiers that said nothing since `open`, by what was wrong with them."""
        return self._inbox.counts

    @property
    def topology(self) -> Topology:
        """What is on which bus."""
        return self._topology

    @property
    def temperatures_degc(self) -> Mapping[str, int]:
        """The newest temperature of every module that has answered, by its name."""
        watches = self._inbox.watches.values()
        return {watch.module.name: degrees for watch in watches if (degrees := watch.temperature_degc) is not None}

    @property
    def missing(self) -> tuple[str, ...]:
        """Names of the modules that have not answered since `open`."""
        return tuple(watch.module.name for watch in self._inbox.watches.values() if not watch.answered)

    def open(self) -> None:
        """Open every bus; nothing moves. Sequences start anew. `DeviceUnreachable` if a bus cannot be opened."""
        if self._wires:
            return
        inbox = Inbox(self._topology, self._draw() % SEQUENCES, self._draw() % SEQUENCES)
        opened: dict[str, Wire] = {}
        try:
            for spec in self._topology.buses:
                handlers, lengths = inbox.listen(spec)
                opened[spec.name] = Wire(self._open_bus(spec, sorted(handlers)), spec.profile, handlers, lengths)
        except BaseException:
            for wire in opened.values():
                wire.close()
            raise
        self._inbox, self._wires = inbox, opened
        self._wire_of = {module.node: opened[spec.name] for spec in self._topology.buses for module in spec.modules}
        self._outputs = list(_outputs(self._topology, opened))
        self._status, self._fault = DeviceStatus.DISARMED, ""
        self._sequence, self._sent_ns, self._untaken = -1, None, 0

    def read(self, now_ns: int) -> RobotState:
        """Take what has come, judge it, poll if no command went out, and return the newest samples."""
        inbox = self._inbox
        if self._wires:
            for wire in self._wires.values():
                wire.drain()
            self._judge()
            self._continue_arming(now_ns)
            if self._poll_due(now_ns):
                self._repeat_stop()
                self._broadcast(now_ns, WireMode.POLL, self._nothing, self._nothing, _NO_COMMAND)
        position, velocity, torque = inbox.samples.values()
        sequence = min(watch.taken for watch in inbox.watches.values())
        return RobotState(sequence, position, velocity, torque, inbox.samples.stamps(), self._status, self._fault)

    def arm(self, now_ns: int) -> None:
        """Begin to arm; ARMED follows in a later `read`, when every module has confirmed.

        Raises:
            RuntimeError: a module or a bus is not fit to be armed.
        """
        refusal = self._unfit()
        if refusal:
            raise RuntimeError(f"arm: {refusal}")
        for watch in self._inbox.watches.values():
            watch.rearm()
        for wire in self._wires.values():
            wire.health.forget()
        self._session = _other(self._draw, self._session)
        cycle_us, retry_ns = round(self.config.period_s * 1e6), round(self.config.arming_retry_s * 1e9)
        self._inbox.arming = Arming(self._topology.modules, self._session, cycle_us, now_ns, retry_ns, self._tag)
        self._inbox.session, self._inbox.alarm = 0, ""
        self._status, self._fault, self._untaken = DeviceStatus.DISARMED, "", 0
        self._continue_arming(now_ns)

    def write(self, command: RobotCommand, now_ns: int) -> bool:
        """Broadcast a command if ARMED, newer than the last and finite; False also when a bus did not take it."""
        if self._status is not DeviceStatus.ARMED or command.sequence <= self._sequence or not _finite(command):
            return False
        self._sequence = command.sequence
        target = command.torque if command.mode is Mode.TORQUE else command.position
        taken = self._broadcast(now_ns, WireMode(command.mode), target, command.torque_limit, command.sequence)
        self._untaken = 0 if taken else self._untaken + 1
        return taken

    def stop(self, reason: str, now_ns: int) -> None:
        """Latch STOPPED and stop every module; what is still on its way to them is of a session that has ended."""
        self._leave(DeviceStatus.STOPPED, reason, StopReason.ORDER)

    def close(self) -> None:
        """Stop every module and give the buses back; may be called twice."""
        if not self._wires:
            return
        self._leave(DeviceStatus.DISARMED, "", StopReason.CLOSING)
        for wire in self._wires.values():
            wire.close()
        self._wires, self._wire_of, self._outputs = {}, {}, []

    def _judge(self) -> None:
        """Go to FAULT, with a quick stop, for the first thing that forbids driving on."""
        if self._status is not DeviceStatus.ARMED:
            return
        fault, reason = self._bus_fault(), StopReason.BUS_FAULT
        if not fault:
            fault, reason = self._inbox.alarm, StopReason.ORDER
        if not fault:
            fault, reason = self._module_fault()
        if fault:
            self._leave(DeviceStatus.FAULT, fault, reason)

    def _bus_fault(self) -> str:
        for name, wire in self._wires.items():
            if wire.health.was_off:
                return f"bus {name} is off or has been"
            if wire.trouble:
                return f"bus {name}: {wire.trouble}"
        if self._untaken >= self.config.lost_cycles:
            return f"{self._untaken} commands in a row could not be sent: transmit queue full"
        return ""

    def _module_fault(self) -> tuple[str, StopReason]:
        newest, patience = self._inbox.log.newest, self.config.lost_cycles
        for watch in self._inbox.watches.values():
            if newest - watch.heard > patience:
                return watch.life_fault(newest, patience), StopReason.NODE_LOST
            fault = watch.armed_fault(self._armed_since) or watch.identity_fault()
            if fault:
                return fault, StopReason.MODULE_FAULT
        return "", StopReason.ORDER

    def _unfit(self) -> str:
        """Return why nothing may be armed now, or an empty text."""
        if not self._wires:
            return "the device is not open"
        for name, wire in self._wires.items():
            if wire.health.condition is BusCondition.OFF:
                return f"bus {name} is off"
        for watch in self._inbox.watches.values():
            if not watch.answered:
                return f"{watch} has not answered"
            fault = watch.life_fault(self._inbox.log.newest, self.config.lost_cycles) or watch.identity_fault()
            if fault:
                return fault
        return ""

    def _continue_arming(self, now_ns: int) -> None:
        arming = self._inbox.arming
        if arming is None:
            return
        if arming.done:
            self._begin_session()
            return
        fault = arming.refusal or self._identity_fault()
        if not fault and now_ns - arming.started_ns > self.config.arming_s * 1e9:
            fault = f"not armed within {self.config.arming_s:g} s: no answer from {arming.waiting_for}"
        if fault:
            self._leave(DeviceStatus.FAULT, fault, StopReason.MODULE_FAULT)
            return
        for node, request in arming.due(now_ns):
            frame_id = request_id(node)
            self._wire_of[node].send(frame_id, encode_request(frame_id, request))
        self._tag = arming.next_tag

    def _begin_session(self) -> None:
        """Be ARMED: from the next broadcast on every module must say the same."""
        inbox = self._inbox
        inbox.arming, inbox.session = None, self._session
        self._armed_since = inbox.log.newest
        self._status = DeviceStatus.ARMED
        for watch in inbox.watches.values():
            watch.taken = self._sequence

    def _identity_fault(self) -> str:
        return next((fault for watch in self._inbox.watches.values() if (fault := watch.identity_fault())), "")

    def _leave(self, status: DeviceStatus, fault: str, reason: StopReason) -> None:
        """Leave ARMED, whatever was: end the session and stop every module."""
        self._status, self._fault = status, fault
        self._inbox.arming, self._inbox.session = None, 0
        self._send_quick_stop(reason)

    def _send_quick_stop(self, reason: StopReason) -> None:
        self._inbox.stops = (self._inbox.stops + 1) % SEQUENCES
        payload = encode_quick_stop(QuickStop(reason, HOST, self._inbox.stops))
        for wire in self._wires.values():
            wire.send(QUICK_STOP_ID, payload)

    def _repeat_stop(self) -> None:
        """Stop modules that say they are armed though nobody has armed them: a quick stop can be lost, too."""
        if self._status is DeviceStatus.ARMED or self._inbox.arming is not None:
            return
        if any(watch.state is ModuleState.ARMED for watch in self._inbox.watches.values() if watch.answered):
            self._send_quick_stop(StopReason.ORDER)

    def _poll_due(self, now_ns: int) -> bool:
        """Tell whether no broadcast has gone out for a period, or for longer while nothing answers."""
        if self._sent_ns is None:
            return True
        waited_ns = now_ns - self._sent_ns
        share = _COMMAND_SHARE if self._inbox.log.command(self._inbox.log.newest) != _NO_COMMAND else _POLL_SHARE
        if waited_ns < share * self.config.period_s * 1e9:
            return False
        heard = max(watch.heard for watch in self._inbox.watches.values())
        silent = self._inbox.log.newest - heard > self.config.lost_cycles
        return not silent or waited_ns >= self.config.silent_poll_s * 1e9

    def _broadcast(self, now_ns: int, mode: WireMode, target: Vector, limit: Vector, command: int) -> bool:
        """Send one broadcast to every group; return whether every bus has taken it."""
        sequence = self._inbox.log.add(now_ns, command)
        self._sent_ns = now_ns
        counts = self._counts.of(target, limit)
        taken = True
        for output in self._outputs:
            codec, payload = output.codec, output.payload
            session, enable = (0, 0) if mode is WireMode.POLL else (self._session, codec.everything)
            codec.pack(payload, session, sequence, mode, enable, counts[output.own])
            taken &= output.wire.send(codec.frame_id, payload) is SendStatus.SENT
        return taken


def _outputs(topology: Topology, wires: Mapping[str, Wire]) -> Iterator[_Output]:
    """Yield the broadcasts of all groups, in the topology's order."""
    first = 0
    for spec in topology.buses:
        for group in spec.groups:
            codec, count = CommandCodec(group), 2 * len(group.joints)
            yield _Output(codec, codec.new_payload(), slice(first, first + count), wires[spec.name])
            first += count


def _other(draw: Callable[[], int], session: int) -> int:
    """Return a new session number: not the present one, and not 0, which polls carry."""
    drawn = draw() % (1 << 32)
    return drawn if drawn not in (0, session) else session % ((1 << 32) - 1) + 1


def _finite(command: RobotCommand) -> bool:
    """Tell whether every value is a number: then, and only then, the sum of their squares is one."""
    position, limit, torque = command.position, command.torque_limit, command.torque
    return math.isfinite(position @ position + limit @ limit + torque @ torque)
