"""One direction of a bus on which frames are lost, doubled, corrupted, held back and overtaken. Pure: time comes in."""

from __future__ import annotations

import heapq
from collections.abc import Iterator
from copy import copy
from itertools import count

import can

from preshape.sim_backend.frame_lottery import Fate, FrameLottery


class DelayLine:
    """Takes frames with the time they were sent, gives them back when they are due, in that order.

    Frames due at one time come in the order in which they were put in; one that a lottery lets come after the
    next waits for it.
    """

    def __init__(self, lottery: FrameLottery) -> None:
        """Let a lottery decide what becomes of each frame."""
        self._lottery = lottery
        self._order = count()
        self._waiting: list[tuple[int, int, can.Message]] = []
        self._overtaken: list[tuple[int, can.Message]] = []

    def put(self, message: can.Message, sent_ns: int) -> None:
        """Take a frame."""
        fate = self._lottery.draw(len(message.data))
        if not fate.copies:
            return
        due_ns = sent_ns + round(fate.delay_s * 1e9)
        overtaken, self._overtaken = self._overtaken, []
        for _ in range(fate.copies):
            frame = _changed(message, fate)
            if fate.after_next:
                self._overtaken.append((due_ns, frame))
            else:
                heapq.heappush(self._waiting, (due_ns, next(self._order), frame))
        for earlier_ns, frame in overtaken:
            heapq.heappush(self._waiting, (max(earlier_ns, due_ns), next(self._order), frame))

    def due(self, now_ns: int) -> Iterator[can.Message]:
        """Give back every frame that is due."""
        while self._waiting and self._waiting[0][0] <= now_ns:
            yield heapq.heappop(self._waiting)[2]

    @property
    def next_due_ns(self) -> int | None:
        """When the next frame is due; None: there is none."""
        return self._waiting[0][0] if self._waiting else None

    def clear(self) -> None:
        """Lose everything that is on its way."""
        self._waiting.clear()
        self._overtaken.clear()


def _changed(message: can.Message, fate: Fate) -> can.Message:
    frame = copy(message)
    frame.data = bytearray(fate.applied(bytes(message.data)))
    return frame
