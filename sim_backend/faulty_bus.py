"""A python-can bus on which things go wrong as planned: the fault injector at the frame boundary.

It wraps one end of a bus, the controller's or the modules', so that every frame meets it once. Frames that are held
back leave when either `send` or `recv` is called at or after their time, on the clock it is given.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable
from typing import Literal

import can

from preshape.hal.can.identifiers import (
    EMERGENCY_BASE,
    HEARTBEAT_BASE,
    NODES,
    REPLY_BASE,
    REQUEST_BASE,
    STATE_BASE,
)
from preshape.sim_backend.delay_line import DelayLine
from preshape.sim_backend.fault_plan import FrameFaults
from preshape.sim_backend.frame_lottery import FrameLottery

End = Literal["host", "modules"]

BUS_OFF_ERROR_ID, RESTARTED_ERROR_ID = 0x040, 0x100
"""Classes of the error frames by which SocketCAN says that the controller is off the bus, and that it is back."""
NODE_BASES = (EMERGENCY_BASE, STATE_BASE, REPLY_BASE, REQUEST_BASE, HEARTBEAT_BASE)
"""Where the identifiers begin that name the node they come from or go to."""

Rewrite = Callable[[can.Message], can.Message]


def node_of(frame_id: int) -> int | None:
    """Return the node that a frame comes from or goes to, None for a broadcast."""
    return next((frame_id - base for base in NODE_BASES if frame_id - base in NODES), None)


class FaultyBus(can.BusABC):
    """One end of a bus with faults.

    `off`: nothing passes; `silent`: the nodes whose frames are lost, to and from; `rewrite`: node -> what is done to
    each of its frames before anything else happens to it. All three may be changed at any time.
    """

    def __init__(self, bus: can.BusABC, end: End, faults: FrameFaults, seed: int, now_ns: Callable[[], int]) -> None:
        """Wrap an end of a bus; the same seed and the same frames at the same times give the same faults."""
        super().__init__(channel=bus.channel_info)
        self.channel_info = bus.channel_info
        self._can_protocol = bus.protocol
        self.silent: set[int] = set()
        self.rewrite: dict[int, Rewrite] = {}
        self._bus, self._end, self._now_ns = bus, end, now_ns
        self._off = False
        self._lotteries = tuple(FrameLottery(faults, (seed, direction)) for direction in range(2))
        self._outgoing, self._incoming = (DelayLine(lottery) for lottery in self._lotteries)
        self._unharmed: deque[can.Message] = deque()
        self._lost = 0

    @property
    def counts(self) -> Counter[str]:
        """How many frames met it, and what happened to how many; `lost`: on a dead bus or at a silent node."""
        total = self._lotteries[0].counts + self._lotteries[1].counts
        total["lost"] = self._lost
        return total

    @property
    def off(self) -> bool:
        """Whether the controller's node is off the bus."""
        return self._off

    def go_off(self) -> None:
        """Take the controller off the bus: it is told by an error frame, and what is on its way is lost."""
        self._off = True
        self._outgoing.clear()
        self._incoming.clear()
        self._tell_host(BUS_OFF_ERROR_ID)

    def come_back(self) -> None:
        """Let frames pass again; the controller is told that its node has restarted."""
        self._off = False
        self._tell_host(RESTARTED_ERROR_ID)

    def _tell_host(self, error_class: int) -> None:
        error = can.Message(
            arbitration_id=error_class, is_error_frame=True, is_extended_id=False, data=bytes(8),
            timestamp=self._now_ns() * 1e-9,
        )  # fmt: skip
        if self._end == "host":
            self._unharmed.append(error)
        else:
            self._bus.send(error)

    def send(self, msg: can.Message, timeout: float | None = None) -> None:
        """Send a frame, or what becomes of it, and everything else that is due."""
        self._take(msg, self._outgoing)
        self._release(timeout)

    def _release(self, timeout: float | None = 0.0) -> None:
        for message in self._outgoing.due(self._now_ns()):
            self._bus.send(message, timeout)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        self._release()
        while (received := self._bus.recv(0.0)) is not None:
            self._receive(received)
        message = self._next()
        if message is None and timeout != 0.0:
            received = self._bus.recv(self._patience_s(timeout))
            if received is not None:
                self._receive(received)
            message = self._next()
        return message, True

    def _receive(self, message: can.Message) -> None:
        if message.is_error_frame:
            self._unharmed.append(message)
        else:
            self._take(message, self._incoming)

    def _take(self, message: can.Message, line: DelayLine) -> None:
        node = node_of(message.arbitration_id)
        if self._off or node in self.silent:
            self._lost += 1
            return
        if node is not None and node in self.rewrite:
            message = self.rewrite[node](message)
        line.put(message, self._now_ns())

    def _next(self) -> can.Message | None:
        if self._unharmed:
            return self._unharmed.popleft()
        return next(self._incoming.due(self._now_ns()), None)

    def _patience_s(self, timeout: float | None) -> float | None:
        """Return how long to wait for a frame: not beyond the time limit, nor beyond the next frame that is due."""
        due = [when for when in (self._incoming.next_due_ns, self._outgoing.next_due_ns) if when is not None]
        if not due:
            return timeout
        left_s = max(0.0, (min(due) - self._now_ns()) * 1e-9)
        return left_s if timeout is None else min(timeout, left_s)

    def shutdown(self) -> None:
        """Close the bus; what is on its way is lost."""
        super().shutdown()
        self._outgoing.clear()
        self._incoming.clear()
        self._bus.shutdown()

    def fileno(self) -> int:
        """Return the wrapped bus' file descriptor."""
        return self._bus.fileno()

    def set_filters(self, filters: can.typechecking.CanFilters | None = None) -> None:
        """Set the wrapped bus' filters."""
        super().set_filters(filters)
        if hasattr(self, "_bus"):
            self._bus.set_filters(filters)
