"""Who watches the loop: observers are told of every tick and can neither delay nor break it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Protocol

from preshape.hal.tick_record import TickRecord


class Observer(Protocol):
    """Something that is told of every tick: a recorder, a ring to another process, a storyboard.

    `notify` must never wait: no lock that another thread may hold, no file, no socket. The record is the
    loop's own buffer and is overwritten in the next tick: copy what is kept. An observer that cannot keep up
    drops records and counts them.
    """

    def notify(self, record: TickRecord) -> None:
        """Take note of one tick."""
        ...


class Observers:
    """All observers of one loop, told in order.

    One that raises is told nothing more, and its error is kept in `failures`: watching never stops the work.
    """

    def __init__(self, observers: Iterable[Observer] = ()) -> None:
        """Take the observers in the order in which they are to be told."""
        self._active = list(observers)
        self.failures: list[tuple[str, Exception]] = []

    def add(self, observer: Observer) -> None:
        """Tell this one, too, from the next tick on."""
        self._active.append(observer)

    def notify(self, record: TickRecord) -> None:
        """Tell every observer of one tick."""
        for observer in tuple(self._active):
            try:
                observer.notify(record)
            except Exception as error:
                self._active.remove(observer)
                self.failures.append((type(observer).__name__, error))
