"""Requests to services and their answers: JSON with a sequence and an expiry in, a code and a reason out."""

from __future__ import annotations

from collections import OrderedDict
from typing import Any, Literal

import msgspec

from preshape.hal.received_json import decode_received
from preshape.tools.telemetry_messages import Health, Message, TaskState

AnswerCode = Literal[
    "done", "bad_request", "expired", "out_of_sequence", "switched_off", "unknown", "out_of_range", "not_now"
]
LONGEST_NS = 60_000_000_000
"""How far ahead a request may expire, ns."""
CLIENTS = 256
"""How many clients' sequences are remembered; who has been silent longest is forgotten first."""
LARGEST_BYTES = 4096
"""Longest request that is read."""


class Request(Message, frozen=True, tag="preshape/request/1"):
    """A request to `call/<service>` or `param/<name>`.

    Attributes:
        client: who asks; each client counts its own requests.
        seq: larger than in this client's request before, so that none is carried out twice.
        expires_ns: Unix time from which on it must not be carried out, at most a minute ahead.
        value: of a parameter that is to be set, or of a goal (the last task to be carried out); absent: asked for.
        reason: of a stop, in words.
    """

    client: str
    seq: int
    expires_ns: int
    value: float | None = None
    reason: str = ""


REQUEST = msgspec.json.Decoder(Request)


class Answer(Message, frozen=True, tag="preshape/answer/1"):
    """The answer to any request: `code` is "done", or says why not, and `reason` says it in words."""

    service: str
    code: AnswerCode
    reason: str
    seq: int | None = None
    value: float | str | None = None


class Status(Message, frozen=True, tag="preshape/status/1"):
    """The answer to `call/status`: the newest of everything, and what the telemetry itself has done."""

    robot: str
    device: str
    loop: Health | None
    joints: Health | None
    buses: list[Health]
    telemetry: Health
    task: TaskState | None
    parts: dict[str, str]
    stop_reason: str
    parameters: dict[str, Any]


class Refused(Exception):
    """A request that is not carried out, with its code and reason."""

    def __init__(self, code: AnswerCode, reason: str, seq: int | None = None) -> None:
        """Say why; `seq` is the request's own, as far as it could be read."""
        super().__init__(reason)
        self.code: AnswerCode = code
        self.reason, self.seq = reason, seq


class RequestCheck:
    """Reads requests and refuses those that are malformed, too late, or have been there before."""

    def __init__(self) -> None:
        """Start without knowing any client."""
        self._last: OrderedDict[str, int] = OrderedDict()

    def read(self, payload: bytes, now_ns: int) -> Request:
        """Return the request in a payload that may be carried out at this Unix time; `Refused` otherwise."""
        if len(payload) > LARGEST_BYTES:
            raise Refused("bad_request", f"got {len(payload)} bytes, allowed are {LARGEST_BYTES}")
        try:
            request = decode_received(REQUEST, payload)
        except msgspec.DecodeError as error:
            raise Refused("bad_request", str(error)) from error
        if not 1 <= len(request.client) <= 64:
            raise Refused("bad_request", "client: allowed is a name of 1 to 64 characters", request.seq)
        if not now_ns < request.expires_ns <= now_ns + LONGEST_NS:
            ahead_s = (request.expires_ns - now_ns) * 1e-9
            raise Refused("expired", f"expires_ns: {ahead_s:.3f} s from now, allowed is > 0 and <= 60 s", request.seq)
        last = self._last.get(request.client)
        if last is not None and request.seq <= last:
            raise Refused("out_of_sequence", f"seq: got {request.seq}, allowed is > {last}", request.seq)
        self._last[request.client] = request.seq
        self._last.move_to_end(request.client)
        if len(self._last) > CLIENTS:
            self._last.popitem(last=False)
        return request
