"""What a client asks of a served device, besides states and commands: JSON questions and answers."""

from __future__ import annotations

import hashlib
from typing import Any

import msgspec

from preshape.hal.received_json import decode_received

DEVICE_KEY = "device"
"""What stands between the robot's id and everything here: `preshape/<robot>/device/...`."""

CALLS = ("open", "arm", "stop", "close", "image", "opening", "finish")
"""What may be asked for, each under its own key; `image`, `opening` and `finish` only where a world is served."""

STREAMS = ("state", "perception", "scene")
"""What is published: joint states; what is seen of the object and obstacles; everything's position, for pictures."""


class Question(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A question. `client` is a number that the client has drawn; only the one that has opened is obeyed."""

    client: int
    now_ns: int
    reason: str = ""
    arguments: dict[str, Any] = {}


class Reply(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """The reply: `refused` says why not, and is empty when it was done; `epoch` is that of commands from now on."""

    refused: str = ""
    epoch: int = 0
    now_ns: int = 0
    world: dict[str, Any] | None = None


class SeenObstacle(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One obstacle: pose in the world, row by row, and half edges, m."""

    name: str
    X_world_box: list[float]
    half: list[float]


class Seen(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """What the scene's sensors say: the newest pose sample that has arrived, and the obstacles."""

    stamp_ns: int | None
    X_world_box: list[float]
    obstacles: list[SeenObstacle]


_QUESTION, _REPLY, _SEEN = msgspec.json.Decoder(Question), msgspec.json.Decoder(Reply), msgspec.json.Decoder(Seen)


def life_token(client: int) -> str:
    """Return what a client's sign of life is called, which all may see: it does not tell the client's number."""
    return hashlib.sha256(str(client).encode()).hexdigest()[:16]


def encode(value: msgspec.Struct) -> bytes:
    """Return JSON."""
    return msgspec.json.encode(value)


def decode_question(payload: bytes) -> Question:
    """Return the question in JSON; `ValueError` if it is none."""
    return decode_received(_QUESTION, payload)


def decode_reply(payload: bytes) -> Reply:
    """Return the reply in JSON; `ValueError` if it is none."""
    return decode_received(_REPLY, payload)


def decode_seen(payload: bytes) -> Seen:
    """Return what is seen, in JSON; `ValueError` if it is none."""
    return decode_received(_SEEN, payload)
