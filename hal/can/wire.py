"""One bus in the hands of its one owner: payloads out and in, never waiting, failures counted instead of raised."""

from __future__ import annotations

import errno
from collections import Counter
from collections.abc import Callable, Mapping
from enum import Enum
from typing import Any, cast

import can

from preshape.hal.can.bus_health import BusHealth
from preshape.hal.can.checksum import Bytes
from preshape.hal.can.slices import TAGS, Joiner, cut
from preshape.hal.can.topology import Profile

MOST_FRAMES = 1024
"""Frames that one `drain` takes at most: a babbling bus must not hold the loop."""

_FULL = frozenset({errno.ENOBUFS, errno.EAGAIN})

Handler = Callable[[bytes | bytearray], None]


class SendStatus(Enum):
    """What became of a payload handed to the bus."""

    SENT = "sent"
    FULL = "transmit queue full"
    FAILED = "not sent"


class _Frame(can.Message):
    """A frame whose content is `bytes`, which its copies share: python-can's virtual bus copies for each listener."""

    __slots__ = ()

    def __deepcopy__(self, memo: dict[int, Any] | None) -> can.Message:
        copy = can.Message.__new__(can.Message)
        copy.timestamp, copy.channel = self.timestamp, self.channel
        copy.arbitration_id, copy.dlc, copy.data = self.arbitration_id, self.dlc, self.data
        copy.is_extended_id, copy.is_remote_frame, copy.is_error_frame = False, False, False
        copy.is_fd, copy.is_rx, copy.bitrate_switch = self.is_fd, self.is_rx, self.bitrate_switch
        copy.error_state_indicator = False
        return copy


class Wire:
    """Sends and receives whole payloads on one bus; on a classic one by way of slices.

    `health` follows error frames; `counts` says how many frames were received, foreign (extended, remote or of an
    unknown identifier), unreadable, sent, refused because the queue was full, or failed; `trouble` is the text of
    the last failure that was not a full queue, empty after the next success.
    """

    def __init__(
        self, bus: can.BusABC, profile: Profile, handlers: Mapping[int, Handler], lengths: Mapping[int, int]
    ) -> None:
        """Take over an open bus. `handlers` are told of payloads by identifier; `lengths` are theirs, in bytes."""
        self.health = BusHealth()
        self.counts: Counter[str] = Counter()
        self.trouble = ""
        self._bus, self._fd = bus, profile == "fd"
        self._handlers = dict(handlers)
        self._joiners = {} if self._fd else {number: Joiner(length) for number, length in lengths.items()}
        self._messages: dict[int, _Frame] = {}
        self._tag = 0

    def send(self, frame_id: int, payload: bytes | bytearray) -> SendStatus:
        """Hand a payload to the bus, at once or not at all; a payload cut into slices may be sent in part."""
        if self._fd:
            return self._send(frame_id, payload)
        self._tag = (self._tag + 1) % TAGS
        for part in cut(payload, self._tag):
            status = self._send(frame_id, part)
            if status is not SendStatus.SENT:
                return status
        return SendStatus.SENT

    def drain(self) -> None:
        """Tell the handlers of everything that has come; what cannot be read is counted."""
        handlers, counts, receive = self._handlers, self.counts, self._bus.recv
        for _ in range(MOST_FRAMES):
            try:
                message = receive(0.0)
            except (can.CanError, OSError) as error:
                counts["unreadable"] += 1
                if _errno(error) in (errno.ENETDOWN, errno.ENODEV, errno.EBADF):
                    self.trouble = str(error)
                    return
                continue
            if message is None:
                return
            counts["received"] += 1
            if message.is_error_frame:
                self.health.take(message.arbitration_id, message.data)
                continue
            handler = handlers.get(message.arbitration_id)
            if handler is None or message.is_extended_id or message.is_remote_frame:
                counts["foreign"] += 1
                continue
            payload = message.data if self._fd else self._joined(message.arbitration_id, message.data)
            if payload is not None:
                handler(payload)
        counts["flooded"] += 1

    def close(self) -> None:
        """Give the bus back; may be called twice."""
        self._bus.shutdown()

    def _send(self, frame_id: int, content: bytes | bytearray) -> SendStatus:
        message = self._messages.get(frame_id)
        if message is None:
            message = _Frame(
                arbitration_id=frame_id, is_extended_id=False, is_fd=self._fd, bitrate_switch=self._fd, is_rx=False
            )
            self._messages[frame_id] = message
        message.data = cast(bytearray, bytes(content))
        message.dlc = len(content)
        try:
            self._bus.send(message, timeout=0)
        except (can.CanError, OSError) as error:
            return self._failed(error)
        self.counts["sent"] += 1
        self.trouble = ""
        return SendStatus.SENT

    def _failed(self, error: Exception) -> SendStatus:
        """Tell a full queue, which python-can reports with errno 105 or with no errno at all, from the rest."""
        number = _errno(error)
        if number in _FULL or number is None:
            self.counts["full"] += 1
            return SendStatus.FULL
        self.counts["failed"] += 1
        self.trouble = str(error)
        return SendStatus.FAILED

    def _joined(self, frame_id: int, content: Bytes) -> bytes | None:
        joiner = self._joiners.get(frame_id)
        return None if joiner is None else joiner.add(content)


def _errno(error: Exception) -> int | None:
    """Return the errno of a failure, wherever python-can has put it."""
    places = getattr(error, "error_code", None), getattr(error, "errno", None), getattr(error.__cause__, "errno", None)
    return next((place for place in places if place is not None), None)
