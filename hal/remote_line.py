"""A client's line to a served device over Zenoh: questions with an answer, the newest message of each stream."""

from __future__ import annotations

import secrets
import time
from collections.abc import Mapping
from threading import Event
from typing import Any

import zenoh

from preshape.hal.device import DeviceUnreachable
from preshape.hal.remote_calls import STREAMS, Question, Reply, decode_reply, encode, life_token

ANSWER_S = 5.0
"""Longest time until an answer, s."""
SLOW_ANSWERS_S = {"finish": 60.0}
"""The same for what takes longer."""
KEPT = 512
"""Messages of one stream that wait to be looked at; more push out the oldest, which then count as lost."""


class RemoteLine:
    """What device, perception and referee of one served world share.

    Messages wait outside the interpreter until somebody asks for them: a callback for each would take its lock from
    the controller hundreds of times a second. `first` holds the first payload of each stream and `received` how many
    were looked at; `gone` is set when the server has vanished.
    """

    def __init__(self, session: zenoh.Session, root: str) -> None:
        """Talk to the server under a key, `preshape/<robot>/device`, in an open session; nothing is sent yet."""
        self._session, self._root = session, root
        self.client = secrets.randbits(62)
        self._newest: dict[str, bytes] = {}
        self.first: dict[str, bytes] = {}
        self.received: dict[str, int] = {stream: 0 for stream in STREAMS}
        self.gone = Event()
        self._subscribers: dict[str, Any] = {
            stream: session.declare_subscriber(f"{root}/{stream}", zenoh.handlers.RingChannel(KEPT))
            for stream in STREAMS
        }
        self._watch = session.liveliness().declare_subscriber(f"{root}/alive", self._on_life, history=True)
        # A token of its own: when this process ends, however it does, the server sees it go.
        self._token = session.liveliness().declare_token(f"{root}/client/{life_token(self.client)}")
        self._commands = session.declare_publisher(
            f"{root}/command",
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.REAL_TIME,
            express=True,
        )

    def newest(self, stream: str) -> bytes | None:
        """Return the last payload of a stream that has come, None before the first; to be asked by one thread only."""
        subscriber = self._subscribers.get(stream)
        while subscriber is not None and (sample := subscriber.try_recv()) is not None:
            payload: bytes = sample.payload.to_bytes()
            self.received[stream] += 1
            self.first.setdefault(stream, payload)
            self._newest[stream] = payload
        return self._newest.get(stream)

    def send_command(self, payload: bytes) -> None:
        """Send a command; one that finds no room is dropped. The line's end does not matter: the state will tell."""
        if not self.gone.is_set():
            self._commands.put(payload)

    def tell(self, call: str, reason: str = "", arguments: Mapping[str, Any] | None = None) -> None:
        """Ask without waiting for the answer. What is told and asked is done in that order."""
        if self.gone.is_set():
            return
        question = self._question(reason, arguments or {})
        self._session.get(
            f"{self._root}/call/{call}", lambda reply: None, payload=question, timeout=ANSWER_S,
            priority=zenoh.Priority.REAL_TIME,
        )  # fmt: skip

    def ask(self, call: str, reason: str = "", arguments: Mapping[str, Any] | None = None) -> Reply:
        """Ask and return the answer; `DeviceUnreachable` if none comes, `RuntimeError` with the cause if refused."""
        reply = decode_reply(self.ask_bytes(call, reason, arguments)[0])
        if reply.refused:
            raise RuntimeError(reply.refused)
        return reply

    def ask_bytes(self, call: str, reason: str = "", arguments: Mapping[str, Any] | None = None) -> tuple[bytes, bytes]:
        """Ask and return the answer's JSON and what is attached to it; `DeviceUnreachable` if none comes."""
        if self.gone.is_set():
            raise DeviceUnreachable(f"{self._root}: its server has gone")
        within_s = SLOW_ANSWERS_S.get(call, ANSWER_S)
        answers = self._session.get(
            f"{self._root}/call/{call}", payload=self._question(reason, arguments or {}), timeout=within_s,
            priority=zenoh.Priority.REAL_TIME,
        )  # fmt: skip
        for answer in answers:
            if answer.ok is not None:
                attached = answer.ok.attachment
                return answer.ok.payload.to_bytes(), b"" if attached is None else attached.to_bytes()
        raise DeviceUnreachable(
            f"{self._root}: no answer to {call} within {within_s:g} s; is `preshape serve` running?"
        )

    def close(self) -> None:
        """Take back what was declared; may be called twice."""
        for declared in (*self._subscribers.values(), self._watch, self._token, self._commands):
            declared.undeclare()
        self._subscribers.clear()

    def _question(self, reason: str, arguments: Mapping[str, Any]) -> bytes:
        now_ns = time.monotonic_ns()
        return encode(Question(client=self.client, now_ns=now_ns, reason=reason, arguments=dict(arguments)))

    def _on_life(self, sample: zenoh.Sample) -> None:
        if sample.kind == zenoh.SampleKind.DELETE:
            self.gone.set()
