"""What comes in from the modules: newest samples, what each module says of itself, and all that said nothing."""

from __future__ import annotations

from collections import Counter
from functools import partial

import numpy as np
from numpy.typing import NDArray

from preshape.hal.can.arming import Arming
from preshape.hal.can.broadcast_log import BroadcastLog
from preshape.hal.can.command_codec import SEQUENCES, CommandCodec
from preshape.hal.can.emergency_codec import EMERGENCY_LENGTH, decode_emergency
from preshape.hal.can.heartbeat_codec import HEARTBEAT_LENGTH, decode_heartbeat
from preshape.hal.can.identifiers import QUICK_STOP_ID, emergency_id, heartbeat_id, reply_id
from preshape.hal.can.node_watch import Answered, NodeWatch
from preshape.hal.can.parameter_codec import PARAMETER_LENGTH, decode_reply
from preshape.hal.can.quick_stop_codec import HOST, QUICK_STOP_LENGTH, decode_quick_stop
from preshape.hal.can.sample_table import SampleTable
from preshape.hal.can.state_codec import StateCodec, status_fields
from preshape.hal.can.topology import BusSpec, Topology
from preshape.hal.can.vocabulary import Parameter, WireMode
from preshape.hal.can.wire import Handler

STATUS = tuple(status_fields(byte) for byte in range(256))
"""What each status byte says."""


class Inbox:
    """Takes every frame that the driver listens to; nothing here sends.

    `samples` are the newest measurements. `watches` are the modules by node. The driver keeps `session`
    (0 while not armed), `stops` (its quick stops' count) and `arming` up to date; `alarm` is what others on the bus
    did that ends driving, else empty.
    """

    def __init__(self, topology: Topology, first_sequence: int = 0, stops: int = 0) -> None:
        self.watches = {module.node: NodeWatch(module) for module in topology.modules}
        self.log = BroadcastLog(first_sequence)
        self.samples = SampleTable(topology)
        self._rows = {module.node: row for row, module in enumerate(topology.modules)}
        self.counts: Counter[str] = Counter()
        """Frames that said nothing: `damaged`, `stale`, `unasked` and `repeated` states, `garbled` others."""
        self.session = 0
        self.stops = stops
        self.arming: Arming | None = None
        self.alarm = ""

    def listen(self, spec: BusSpec) -> tuple[dict[int, Handler], dict[int, int]]:
        """Return what takes the payloads of a bus, and their lengths in bytes, by identifier."""
        handlers: dict[int, Handler] = {QUICK_STOP_ID: self._take_quick_stop}
        lengths = {QUICK_STOP_ID: QUICK_STOP_LENGTH}
        for group in spec.groups:
            codec = CommandCodec(group)
            handlers[codec.frame_id] = partial(self._take_command, codec)
            lengths[codec.frame_id] = codec.length
            for module in group.modules:
                watch, node = self.watches[module.node], module.node
                state = StateCodec(module, group)
                handlers[state.frame_id] = self._state_handler(state, watch)
                handlers[heartbeat_id(node)] = partial(self._take_heartbeat, watch)
                handlers[emergency_id(node)] = partial(self._take_emergency, watch)
                handlers[reply_id(node)] = partial(self._take_reply, watch)
                lengths |= {state.frame_id: state.length, heartbeat_id(node): HEARTBEAT_LENGTH}
                lengths |= {emergency_id(node): EMERGENCY_LENGTH, reply_id(node): PARAMETER_LENGTH}
        return handlers, lengths

    def _state_handler(self, codec: StateCodec, watch: NodeWatch) -> Handler:
        """Return what takes one module's states: the loop's busiest path."""
        counts, samples, log = self.counts, self.samples, self.log
        row = self._rows[watch.module.node]

        def take(payload: bytes | bytearray) -> None:
            fields = codec.unpack(payload)
            status = None if fields is None else STATUS[fields[1]]
            if fields is None or status is None:
                counts["damaged"] += 1
                return
            number = log.find(fields[0])
            if not number:
                counts["unasked"] += 1
                return
            answered = watch.answer(number, payload, log.newest)
            if answered is not Answered.NEWER:
                counts["repeated" if answered is Answered.AGAIN else "stale"] += 1
                return
            watch.state, watch.error, taken = status
            if taken:
                watch.taken = max(watch.taken, log.command(number))
            samples.put(row, fields[3:], log.sent_ns(number))

        return take

    def _take_heartbeat(self, watch: NodeWatch, payload: bytes | bytearray) -> None:
        beat = decode_heartbeat(watch.module.node, payload)
        if beat is None:
            self.counts["garbled"] += 1
        else:
            watch.heartbeat(beat)

    def _take_emergency(self, watch: NodeWatch, payload: bytes | bytearray) -> None:
        emergency = decode_emergency(watch.module.node, payload)
        if emergency is None:
            self.counts["garbled"] += 1
        else:
            watch.emergency = emergency

    def _take_reply(self, watch: NodeWatch, payload: bytes | bytearray) -> None:
        reply = decode_reply(reply_id(watch.module.node), payload)
        if reply is None:
            self.counts["garbled"] += 1
            return
        if reply.parameter is Parameter.FIRMWARE:
            watch.firmware(int(reply.value))
        if self.arming is not None:
            self.arming.take(watch.module.node, reply)

    def _take_quick_stop(self, payload: bytes | bytearray) -> None:
        """Take another's quick stop; one's own comes back on some buses."""
        stop = decode_quick_stop(payload)
        if stop is None or stop.source != HOST or (self.stops - stop.count) % SEQUENCES > SEQUENCES // 2:
            self.alarm = "quick stop by another node of the bus"

    def _take_command(self, codec: CommandCodec, payload: bytes | bytearray) -> None:
        """Notice a second controller; one's own commands come back on some buses."""
        command = codec.decode(payload)
        if command is None or command.mode is WireMode.POLL:
            return
        if self.session and command.session != self.session:
            self.alarm = f"another controller commands {codec.group.name}"


def place(indices: tuple[int, ...]) -> slice | NDArray[np.int64]:
    """Return where joints stand in the layout: a slice if they stand in a row."""
    if list(indices) == list(range(indices[0], indices[0] + len(indices))):
        return slice(indices[0], indices[0] + len(indices))
    return np.array(indices, dtype=np.int64)
