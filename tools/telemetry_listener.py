"""Everything that one robot publishes, in the order in which it came, for a process that takes it when it can."""

from __future__ import annotations

from collections import deque

import msgspec
import zenoh

from preshape.hal.device import DeviceUnreachable
from preshape.tools.telemetry_keys import Keys
from preshape.tools.telemetry_messages import AnyMessage, RobotInfo, decode_message

MOST_WAITING = 20_000
"""Messages that may wait to be taken; the oldest of more are dropped, and counted."""
ASK_S = 2.0
"""Longest time for the last values, s."""


class TelemetryListener:
    """Subscribes to a robot. `take` gives what has come; what is no message of ours is counted in `unreadable`."""

    def __init__(self, session: zenoh.Session, keys: Keys) -> None:
        """Listen from now on, beginning with the last value of every key.

        Raises:
            DeviceUnreachable: no robot of this name publishes there.
        """
        self._keys = keys
        self._waiting: deque[tuple[str, bytes]] = deque(maxlen=MOST_WAITING)
        self.unreadable = self.dropped = 0
        self._subscriber = session.declare_subscriber(keys.of("**"), self._hear)
        kept = {tail: payload for group in ("info/*", "state/**") for tail, payload in self._ask(session, group)}
        if "info/robot" not in kept:
            raise DeviceUnreachable(f"telemetry: no robot publishes {keys.root}/** there")
        self._waiting.extendleft(reversed(kept.items()))
        self._robot = kept["info/robot"]

    @property
    def has_buses(self) -> bool:
        """Whether the robot's joints hang on buses that it tells of."""
        info = decode_message(self._robot)
        return isinstance(info, RobotInfo) and info.device == "can"

    def take(self) -> list[tuple[str, AnyMessage]]:
        """Return all messages that have come since the last call, each with its key's tail."""
        messages: list[tuple[str, AnyMessage]] = []
        while self._waiting:
            tail, payload = self._waiting.popleft()
            try:
                messages.append((tail, decode_message(payload)))
            except msgspec.DecodeError:
                self.unreadable += 1
        return messages

    def close(self) -> None:
        """Listen no more."""
        self._subscriber.undeclare()

    def _hear(self, sample: zenoh.Sample) -> None:
        """Called by Zenoh: nothing here waits."""
        self.dropped += len(self._waiting) == MOST_WAITING
        self._waiting.append((self._tail(sample), sample.payload.to_bytes()))

    def _ask(self, session: zenoh.Session, group: str) -> list[tuple[str, bytes]]:
        replies = session.get(self._keys.of(group), timeout=ASK_S, consolidation=zenoh.ConsolidationMode.NONE)
        samples = [reply.ok for reply in replies if reply.ok is not None]
        return [(self._tail(sample), sample.payload.to_bytes()) for sample in samples]

    def _tail(self, sample: zenoh.Sample) -> str:
        return self._keys.tail(str(sample.key_expr))
