"""The telemetry process: takes tick records from the ring, publishes them over Zenoh, and answers what is asked."""

from __future__ import annotations

import os
import signal
import time
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection

import msgspec

from preshape.hal.byte_ring import PIECE, ByteReader
from preshape.hal.device import DeviceUnreachable
from preshape.hal.tick_record import TickRecord
from preshape.hal.tick_ring import RingMemory, RingReader
from preshape.tools.answer_pack import unpack
from preshape.tools.configuration_error import ConfigurationError
from preshape.tools.part_figures import PartsMemory, PartsReader
from preshape.tools.process_state import process_state
from preshape.tools.telemetry_config import TelemetryConfig
from preshape.tools.telemetry_events import EventFinder
from preshape.tools.telemetry_health import HealthMeter
from preshape.tools.telemetry_info import robot_info, schema_info
from preshape.tools.telemetry_keys import Keys
from preshape.tools.telemetry_messages import (
    Event,
    EventKind,
    Health,
    Heartbeat,
    Message,
    PartState,
    SceneInfo,
    Severity,
    UrdfInfo,
)
from preshape.tools.telemetry_orders import Orders, OrdersMemory
from preshape.tools.telemetry_publisher import RobotPublisher, payload_of
from preshape.tools.telemetry_requests import Answer, Status
from preshape.tools.telemetry_scene import SceneWatch
from preshape.tools.telemetry_services import Services
from preshape.tools.telemetry_states import Stamps, task_state
from preshape.tools.telemetry_streams import StateStreams
from preshape.tools.zenoh_session import open_session, robot_settings

NAP_S = 0.004
"""Longest pause between two looks at the ring, s; a query ends it."""
QUERIES = 64
"""Most queries answered between two looks at the ring."""
SILENT_S = 0.25
"""A paced loop that has written nothing for so long is silent, s."""
URGENCY = -10
"""What is added to the process's niceness where the user may."""
LINGER_S = 0.2
"""How long the session stays open after the last message, s, so that it leaves."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RobotFacts:
    """What the telemetry process is told of the run.

    The device's name, real time or not, the loop's rate, its process, the robot's description and its surroundings.
    """

    device: str
    paced: bool
    rate_hz: float
    pid: int
    urdf: str
    scene: SceneInfo | None = None


@dataclass(frozen=True, slots=True, eq=False)
class BridgeMemory:
    """What the two processes share: tick records, perception's answers and figures of parts out, orders in."""

    ring: RingMemory
    heard: RingMemory
    parts: PartsMemory
    orders: OrdersMemory


def run_bridge(config: TelemetryConfig, facts: RobotFacts, reader: int, memory: BridgeMemory, life: Connection) -> None:
    """Publish until the run has ended. Says "" to `life` when it is ready, or in one line why it will never be."""
    # Ctrl-C reaches every process of a terminal: how the run ends is the loop's to say.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # A stop must come through on a busy machine; everything in real time still goes first.
    with suppress(PermissionError):
        os.nice(URGENCY)
    keys = Keys(config.robot)
    try:
        session = open_session(robot_settings(config.endpoint, [keys.of("**")]), config.zenoh_config)
    except (ConfigurationError, DeviceUnreachable) as error:
        life.send(str(error))
        return
    with session:
        bridge = _Bridge(config, facts, reader, memory)
        bridge.publisher = RobotPublisher(session, keys, config.events_kept, bridge.services.order_stop)
        bridge.begin()
        life.send("")
        while bridge.turn() and not life.poll():
            pass
        bridge.end()
        time.sleep(LINGER_S)


class _Bridge:
    """All that one turn needs."""

    publisher: RobotPublisher

    def __init__(self, config: TelemetryConfig, facts: RobotFacts, reader: int, memory: BridgeMemory) -> None:
        self._config, self._facts = config, facts
        self._ring, self._orders = RingReader(memory.ring, reader), Orders(memory.orders)
        self._answers, self._scene = ByteReader(RingReader(memory.heard, reader, PIECE)), SceneWatch()
        self._figures = PartsReader(memory.parts)
        self._buses: dict[str, Health] = {}
        self._wall_offset_ns = time.time_ns() - time.monotonic_ns()
        self._streams: StateStreams | None = None
        self._events, self._meter = EventFinder(), HealthMeter(round(1e9 / facts.rate_hz))
        self._record: TickRecord | None = None
        self._rates = dict(config.rates())
        own = {"robot": config.robot, "device": facts.device, "loop_rate_hz": facts.rate_hz, "paced": facts.paced}
        self.services = Services(config, self._orders, self._set_rate, own)
        self._parts: dict[str, PartState] = {"telemetry": "running", "loop": "running"}
        self._seq: dict[str, int] = {}
        self._heard_ns = self._beat_ns = self._health_ns = time.monotonic_ns()
        self._dropped = self._put = 0

    def begin(self) -> None:
        """Publish what does not change, and show both parts alive."""
        facts, config = self._facts, self._config
        info = robot_info(config.robot, facts.device, facts.paced, facts.rate_hz, config.rates())
        self.publisher.put("info/robot", msgspec.structs.replace(info, pid=facts.pid))
        self.publisher.put("info/urdf", UrdfInfo(urdf=facts.urdf))
        self.publisher.put("info/schema", schema_info())
        if facts.scene is not None:
            self.publisher.put("info/scene", facts.scene)
        for part in self._parts:
            self.publisher.set_alive(part, True)

    def turn(self) -> bool:
        """Answer, read, publish; return whether the loop may still have something to say."""
        self._serve()
        self._take(self._ring.read())
        now_ns = time.monotonic_ns()
        if now_ns >= self._beat_ns:
            self._beat_ns = now_ns + round(1e9 / self._config.heartbeat_hz)
            self._beat(now_ns)
        if now_ns >= self._health_ns:
            self._health_ns = now_ns + round(1e9 / self._config.health_hz)
            self._publish_health(now_ns)
        return not self._ring.ended and self._parts["loop"] != "gone"

    def end(self) -> None:
        """Publish what is left in the ring, and that the loop has ended."""
        while len(records := self._ring.read()):
            self._take(records)
        if not self._ring.ended:
            self._note("peer", "error", "the loop's process has ended in the middle of the run")
        self._set_part("loop", "gone")
        self._publish_health(time.monotonic_ns())
        for part in self._parts:
            self.publisher.set_alive(part, False)

    def _serve(self) -> None:
        asked = self.publisher.next_query(NAP_S)
        for _ in range(QUERIES):
            if asked is None:
                return
            tail, query = asked
            payload = payload_of(query)
            if tail == "call/status":
                self.publisher.answer(query, tail, self._status(time.monotonic_ns()))
            else:
                answer = self.services.answer(tail, payload, time.time_ns())
                self.publisher.answer(query, tail, answer)
                self._note_answer(answer, bool(payload))
            asked = self.publisher.next_query(0.0)

    def _note_answer(self, answer: Answer, payload: bool) -> None:
        """Tell everybody of what has been changed."""
        if answer.code == "done" and (answer.service.startswith("call/") or answer.reason == "set"):
            self._note("request", "info", f"{answer.service}: {answer.reason}")

    def _take(self, records: TickRecord) -> None:
        if not len(records):
            return
        if self._streams is None:
            self._start_streams(int(records[0]["now_ns"]))
        assert self._streams is not None
        self._heard_ns = time.monotonic_ns()
        self._meter.see(records)
        for record in records:
            for event in self._events.see(record):
                self._publish_event(event)
            for tail, message in self._streams.messages(record):
                self.publisher.put(tail, message)
        self._record = records[-1]
        self._put_all(self._scene.see(records[-1]))
        for answer, pixels in map(unpack, self._answers.read()):
            self._put_all(self._scene.hear(answer, pixels))
        if self._ring.dropped > self._dropped:
            self._note("drops", "warning", f"{self._ring.dropped - self._dropped} tick records lost on their way here")
            self._dropped = self._ring.dropped

    def _put_all(self, messages: list[tuple[str, Message]]) -> None:
        for tail, message in messages:
            self.publisher.put(tail, message)

    def _start_streams(self, first_ns: int) -> None:
        """Relate the loop's clock to Unix time: in lockstep simulated time counts from now."""
        if not self._facts.paced:
            self._wall_offset_ns = time.time_ns() - first_ns
        self._streams = StateStreams(self._rates, self._wall_offset_ns)
        self._events.wall_offset_ns = self._meter.wall_offset_ns = self._wall_offset_ns
        self._scene.wall_offset_ns = self._wall_offset_ns

    def _set_rate(self, tail: str, rate_hz: float) -> None:
        self._rates[tail] = rate_hz
        if self._streams is not None:
            self._streams.set_rate(tail, rate_hz)

    def _beat(self, now_ns: int) -> None:
        """Publish every part's heartbeat, and an event for each that has changed."""
        state = process_state(self._facts.pid)
        if state == "running" and self._facts.paced and self._record is not None:
            state = "silent" if now_ns - self._heard_ns > SILENT_S * 1e9 else state
        self._set_part("loop", state)
        for part, part_state in self._parts.items():
            beat = Heartbeat(
                seq=self._next(f"alive/{part}"),
                stamp_ns=time.time_ns(),
                mono_ns=now_ns,
                part=part,
                state=part_state,
                period_s=1.0 / self._config.heartbeat_hz,
                pid=os.getpid() if part == "telemetry" else self._facts.pid,
            )
            self.publisher.put(f"alive/{part}", beat)

    def _set_part(self, part: str, state: PartState) -> None:
        if self._parts[part] != state:
            self._parts[part] = state
            self._note("peer", "info" if state == "running" else "warning", f"{part} is {state}")

    def _publish_health(self, now_ns: int) -> None:
        names = "loop", self._facts.device
        for name, health in zip(names, self._device_health(self._next("health")), strict=True):
            if health is not None:
                self.publisher.put(f"health/{name}", health)
        self._publish_buses(now_ns)
        self.publisher.put("health/telemetry", self._own_health(now_ns, self._next("health/telemetry")))
        self._put = self.publisher.count

    def _publish_buses(self, now_ns: int) -> None:
        """Publish what is new of the device's buses."""
        for part in self._figures.newest() or ():
            health = self._buses[part.name] = Health(
                seq=self._next(f"health/{part.name}"),
                stamp_ns=time.time_ns(),
                mono_ns=part.mono_ns,
                device=part.name,
                status=part.status,
                fault=part.fault,
                count=part.count,
                rate_hz=part.rate_hz,
                bus_load=part.bus_load,
                bus_errors=part.bus_errors,
                temperature_c=part.temperature_c,
            )
            self.publisher.put(f"health/{part.name}", health)

    def _device_health(self, seq: int) -> tuple[Health | None, Health | None]:
        return self._meter.loop(seq), self._meter.device(self._facts.device, seq)

    def _own_health(self, now_ns: int, seq: int) -> Health:
        return Health(
            seq=seq,
            stamp_ns=time.time_ns(),
            mono_ns=now_ns,
            device="telemetry",
            status="RUNNING",
            fault="",
            count=self.publisher.count,
            rate_hz=(self.publisher.count - self._put) * self._config.health_hz,
            drops=self._ring.dropped,
        )

    def _status(self, now_ns: int) -> Status:
        loop, device = self._device_health(self._seq.get("health", 0))
        task = None if self._record is None else task_state(self._record, Stamps(0, self._wall_offset_ns))
        return Status(
            robot=self._config.robot,
            device=self._facts.device,
            loop=loop,
            joints=device,
            buses=list(self._buses.values()),
            telemetry=self._own_health(now_ns, self._seq.get("health/telemetry", 0)),
            task=task,
            parts=dict(self._parts),
            stop_reason=self._orders.stop_reason,
            parameters=self.services.parameters,
        )

    def _note(self, kind: EventKind, severity: Severity, text: str) -> None:
        self._publish_event(self._events.note(kind, severity, text))

    def _publish_event(self, event: Event) -> None:
        self.publisher.put("event", event)

    def _next(self, stream: str) -> int:
        seq = self._seq.get(stream, 0)
        self._seq[stream] = seq + 1
        return seq
