"""Serves a device, and the world around it, to one client over Zenoh: states out, commands in, questions answered."""

from __future__ import annotations

import gc
import time
from collections import Counter
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from queue import Empty, Queue
from typing import Any

import msgspec
import zenoh

from preshape.hal.device import DeviceUnreachable
from preshape.hal.gate_config import AgeTier, GateConfig
from preshape.hal.remote_calls import CALLS, Question, Reply, Seen, SeenObstacle, decode_question, encode, life_token
from preshape.hal.remote_wire import command_of, decode_command, encode_state
from preshape.tools.run_world import RunWorld
from preshape.tools.served_opening import opening_from
from preshape.tools.telemetry_publisher import payload_of

SEEN_EVERY, SCENE_EVERY = 5, 20
"""Of so many states, one comes with what is seen, or with where everything is."""
NOBODY = 0


@dataclass(frozen=True, slots=True)
class _Arrived:
    """What Zenoh has handed over: a command's bytes, a question, or the token of a client that has gone."""

    call: str
    payload: bytes
    query: zenoh.Query | None = None


class DeviceServer:
    """One device of one world. Whoever opens it is its client until it closes, or goes; all others are refused.

    Commands are taken from the client only, of the present arming, newer than the last, and younger than the age
    from which the safety gate freezes; what does not pass is counted by its reason in `refused`. Silence leads to
    the device's own watchdog; a client that has gone, to a stop. `stop` is taken from anyone.
    """

    def __init__(
        self, session: zenoh.Session, root: str, world: RunWorld, describe: Mapping[str, Any], rate_hz: float = 500.0,
        note: Callable[[str], None] = lambda text: None,
    ) -> None:  # fmt: skip
        """Declare everything under `preshape/<robot>/device`; `describe` is told to clients, `note` of what changes."""
        self._session, self._root, self._world, self._note = session, root, world, note
        self._describe, self._device = dict(describe), world.device
        self._gate, self._period_ns = GateConfig.at_rate(rate_hz), round(1e9 / rate_hz)
        # Not a SimpleQueue: where a signal's handler outlasts the time that its `get` waits, it waits for ever.
        self._inbox: Queue[_Arrived] = Queue()
        self._images = ThreadPoolExecutor(1, "images")
        self._client, self._epoch = NOBODY, 0
        self._seq = self._turns = 0
        self._open = False
        self.finished = False
        self.refused: Counter[str] = Counter()
        self._publishers = {
            stream: session.declare_publisher(
                f"{root}/{stream}", congestion_control=zenoh.CongestionControl.DROP, express=True, priority=priority
            )
            for stream, priority in (
                ("state", zenoh.Priority.REAL_TIME),
                ("perception", zenoh.Priority.DATA_HIGH),
                ("scene", zenoh.Priority.DATA_LOW),
            )
        }
        self._declared: list[Any] = [
            session.declare_subscriber(f"{root}/command", self._on_command),
            # One for all calls: each queryable has a thread of its own, and what is told first must be done first.
            session.declare_queryable(f"{root}/call/*", self._on_question),
            session.liveliness().declare_subscriber(f"{root}/client/*", self._on_life),
            session.liveliness().declare_token(f"{root}/alive"),
        ]

    def run(self, until: Callable[[], bool] = lambda: False) -> None:
        """Serve until a client has finished the world, or `until` says so; then stop the device."""
        # Collecting what lives as long as the process takes tens of milliseconds: states must not wait for it.
        gc.collect()
        gc.freeze()
        due_ns = time.monotonic_ns()
        try:
            while not (self.finished or until()):
                self._publish()
                due_ns = max(due_ns + self._period_ns, time.monotonic_ns())
                self._serve_until(due_ns)
        finally:
            self._images.shutdown(wait=True)
            if self._open and not self.finished:
                self._device.stop("the server has ended", time.monotonic_ns())
                self._device.close()

    def _serve_until(self, due_ns: int) -> None:
        """Work through what arrives until it is time for the next state."""
        while not self.finished:
            left_s = (due_ns - time.monotonic_ns()) * 1e-9
            try:
                arrived = self._inbox.get(timeout=max(0.0, left_s))
            except Empty:
                return
            if arrived.query is not None:
                self._answer(arrived.call, arrived.payload, arrived.query)
            elif arrived.call == "command":
                self._take_command(arrived.payload)
            elif self._client != NOBODY and arrived.payload == life_token(self._client).encode():
                self._lose_client()
            if time.monotonic_ns() >= due_ns:
                return

    def _publish(self) -> None:
        now_ns = time.monotonic_ns()
        if self._open:
            payload = encode_state(self._device.read(now_ns), self._seq, self._epoch, now_ns)
            self._publishers["state"].put(payload)
            self._seq += 1
        if self._turns % SEEN_EVERY == 0:
            self._publishers["perception"].put(encode(self._seen(now_ns)))
        if self._turns % SCENE_EVERY == 0:
            self._publishers["scene"].put(self._world.scene_positions().tobytes())
        self._turns += 1

    def _seen(self, now_ns: int) -> Seen:
        sample = self._world.perception.object_pose(now_ns)
        return Seen(
            stamp_ns=None if sample is None else sample.stamp_ns,
            X_world_box=[] if sample is None else sample.X_world_box.ravel().tolist(),
            obstacles=[
                SeenObstacle(name=one.name, X_world_box=one.X_world_box.ravel().tolist(), half=one.half.tolist())
                for one in self._world.perception.obstacles(now_ns)
            ],
        )

    def _take_command(self, payload: bytes) -> None:
        record, now_ns = decode_command(payload), time.monotonic_ns()
        if record is None:
            self.refused["malformed"] += 1
        elif self._client == NOBODY or int(record["client"]) != self._client:
            self.refused["of another client"] += 1
        elif int(record["epoch"]) != self._epoch:
            self.refused["of another arming"] += 1
        elif self._gate.tier(abs(now_ns - int(record["sent_ns"]))) >= AgeTier.FREEZE:
            self.refused["too old"] += 1
        elif not self._device.write(command_of(record), now_ns):
            self.refused["by the device"] += 1

    def _answer(self, call: str, payload: bytes, query: zenoh.Query) -> None:
        try:
            question = decode_question(payload)
        except ValueError as error:
            self._reply(query, Reply(refused=f"{call}: {error}"))
            return
        own = question.client == self._client
        if call not in CALLS:
            self._reply(query, Reply(refused=f"{call}: no such call, allowed are {', '.join(CALLS)}"))
        elif call == "stop":
            self._stop(question.reason or "no reason given")
            self._reply(query, Reply(epoch=self._epoch))
        elif call == "open":
            self._reply(query, self._open_for(question.client))
        elif not own:
            self._reply(query, Reply(refused=f"{call}: the device is not open for this client"))
        elif call == "image":
            self._images.submit(self._send_image, query)
        else:
            self._reply(query, self._do(call, question))

    def _do(self, call: str, question: Question) -> Reply:
        """Do what the client may ask for, and return what to answer."""
        if call == "arm":
            return self._arm()
        if call == "close":
            self._close()
            return Reply(epoch=self._epoch)
        if call == "opening":
            try:
                self._world.report_opening(*opening_from(question.arguments))
            except msgspec.ValidationError as error:
                return Reply(refused=f"opening: {error}")
            return Reply()
        ended = self._world.finish()
        self.finished = True
        return Reply(world=msgspec.to_builtins(ended))

    def _open_for(self, client: int) -> Reply:
        if self._client not in (NOBODY, client):
            return Reply(refused="the device is open for another client")
        if client == NOBODY:
            return Reply(refused=f"client: got {client}, allowed is any other number")
        now_ns = time.monotonic_ns()
        if self._open:
            self._device.close()
        try:
            self._device.open()
        except DeviceUnreachable as error:
            self._open, self._client = False, NOBODY
            return Reply(refused=str(error))
        self._open, self._client = True, client
        self._epoch += 1
        self._publish()
        self._note("a client has opened the device")
        return Reply(epoch=self._epoch, now_ns=now_ns, world=self._describe)

    def _arm(self) -> Reply:
        self._epoch += 1
        try:
            self._device.arm(time.monotonic_ns())
        except (RuntimeError, DeviceUnreachable) as refusal:
            return Reply(refused=str(refusal), epoch=self._epoch)
        self._publish()
        self._note("armed")
        return Reply(epoch=self._epoch)

    def _stop(self, reason: str) -> None:
        self._epoch += 1
        if self._open:
            self._device.stop(reason, time.monotonic_ns())
            self._note(f"stopped: {reason}")

    def _close(self) -> None:
        self._epoch += 1
        self._device.close()
        self._publish()
        self._open, self._client = False, NOBODY
        self._note("the client has closed the device")

    def _lose_client(self) -> None:
        """Hold where the joints are, latched; the next client has to arm."""
        self._stop("the client has gone")
        self._client = NOBODY

    def _send_image(self, query: zenoh.Query) -> None:
        try:
            image = self._world.perception.image(time.monotonic_ns())
        except DeviceUnreachable as error:
            self._reply(query, Reply(refused=str(error)))
            return
        self._reply(query, Reply(now_ns=image.stamp_ns), image.pixels.tobytes())

    def _reply(self, query: zenoh.Query, reply: Reply, attached: bytes | None = None) -> None:
        try:
            query.reply(query.key_expr, encode(reply), attachment=attached)
        except zenoh.ZError:
            self.refused["answer to nobody"] += 1
        query.drop()

    def _on_command(self, sample: zenoh.Sample) -> None:
        self._inbox.put(_Arrived("command", sample.payload.to_bytes()))

    def _on_question(self, query: zenoh.Query) -> None:
        self._inbox.put(_Arrived(str(query.key_expr).rpartition("/")[2], payload_of(query), query))

    def _on_life(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.DELETE:
            self._inbox.put(_Arrived("gone", str(sample.key_expr).rpartition("/")[2].encode()))
