"""The robot's side of a Zenoh session: publishes messages, keeps the last ones, and collects what is asked."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from functools import partial
from queue import Empty, Queue

import zenoh

from preshape.tools.telemetry_keys import Keys
from preshape.tools.telemetry_messages import Message, encode_message

MOST_WAITING = 512
"""Queries that may wait for their answers; more are dropped unanswered."""

KEPT = ("state/**", "health/*", "event", "info/*")
"""Tails of keys whose last messages can be asked for."""
SERVICES = ("call/*", "param/*")

_STOP = "call/stop"
_JSON = zenoh.Encoding.APPLICATION_JSON


class RobotPublisher:
    """Publishes under one robot's keys.

    State is best effort: what a subscriber is too slow for is dropped for that subscriber. Events are reliable, and
    wait for it. The last message of every key, and the last events, are there for whoever asks for them with a `get`.
    """

    def __init__(self, session: zenoh.Session, keys: Keys, events_kept: int, at_stop: Callable[[bytes], None]) -> None:
        """Declare what others may ask for. `at_stop` is called at once with the payload of every `call/stop`."""
        self._session, self.keys = session, keys
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._last: dict[str, bytes] = {}
        self._events: deque[bytes] = deque(maxlen=events_kept)
        # Not a SimpleQueue: where a signal's handler outlasts the time that its `get` waits, it waits for ever.
        self._inbox: Queue[tuple[str, zenoh.Query]] = Queue()
        self._at_stop = at_stop
        self._queryables = [
            session.declare_queryable(keys.of(group), partial(self._take, group)) for group in (*KEPT, *SERVICES)
        ]
        self._tokens: dict[str, zenoh.LivelinessToken] = {}
        self.count = self.refused = 0

    def put(self, tail: str, message: Message) -> None:
        """Publish a message under the key with this tail."""
        payload = encode_message(message)
        if tail == "event":
            self._events.append(payload)
        else:
            self._last[tail] = payload
        publisher = self._publishers.get(tail)
        if publisher is None:
            publisher = self._publishers[tail] = self._declare(tail)
        publisher.put(payload)
        self.count += 1

    def set_alive(self, part: str, alive: bool) -> None:
        """Show or take back the liveliness token of one part."""
        if alive and part not in self._tokens:
            self._tokens[part] = self._session.liveliness().declare_token(self.keys.of(f"alive/{part}"))
        elif not alive and part in self._tokens:
            self._tokens.pop(part).undeclare()

    def next_query(self, within_s: float) -> tuple[str, zenoh.Query] | None:
        """Return the next query to a service, and its key's tail, None if there is none in time; answer all others."""
        try:
            group, query = self._inbox.get(timeout=within_s)
        except Empty:
            return None
        if group in SERVICES:
            return self._tail(query), query
        self._answer_kept(group, query)
        return None

    def answer(self, query: zenoh.Query, tail: str, message: Message) -> None:
        """Answer a query and be done with it; one whose asker is gone is left."""
        try:
            query.reply(self.keys.of(tail), encode_message(message), encoding=_JSON)
        except zenoh.ZError:
            self.refused += 1
        query.drop()

    def _declare(self, tail: str) -> zenoh.Publisher:
        event = tail == "event"
        urgent = event or tail.startswith("alive/")
        return self._session.declare_publisher(
            self.keys.of(tail),
            encoding=_JSON,
            congestion_control=zenoh.CongestionControl.BLOCK if event else zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.INTERACTIVE_HIGH if urgent else zenoh.Priority.DATA,
            express=True,
            reliability=zenoh.Reliability.RELIABLE if event else zenoh.Reliability.BEST_EFFORT,
        )

    def _take(self, group: str, query: zenoh.Query) -> None:
        """Called by Zenoh: nothing here waits. A stop is carried out before anything else is looked at."""
        tail = self._tail(query)
        if tail == _STOP:
            self._at_stop(payload_of(query))
        elif self._inbox.qsize() >= MOST_WAITING or (group in SERVICES and "*" in tail):
            # A service is asked for by its name: whoever asks for all keys there are wants what is kept.
            self.refused += 1
            query.drop()
            return
        self._inbox.put((group, query))

    def _tail(self, query: zenoh.Query) -> str:
        """Return what is asked for; a stop for every robot there is (`preshape/*/call/stop`) is one for this one."""
        key = str(query.key_expr)
        return _STOP if key.endswith(f"/{_STOP}") else key.removeprefix(f"{self.keys.root}/")

    def _answer_kept(self, group: str, query: zenoh.Query) -> None:
        group_keys, asked = zenoh.KeyExpr(self.keys.of(group)), query.key_expr
        kept = [(tail, payload) for tail, payload in self._last.items() if group_keys.intersects(self.keys.of(tail))]
        if group == "event":
            kept = [("event", payload) for payload in self._events]
        try:
            for tail, payload in kept:
                if asked.intersects(self.keys.of(tail)):
                    query.reply(self.keys.of(tail), payload, encoding=_JSON)
        except zenoh.ZError:
            self.refused += 1
        query.drop()


def payload_of(query: zenoh.Query) -> bytes:
    """Return what a query carries, nothing if it carries nothing."""
    return b"" if query.payload is None else query.payload.to_bytes()
