"""Ctrl-C and requests to terminate as the wish that a program ends, in its own time and order."""

from __future__ import annotations

import signal
from collections.abc import Callable
from contextlib import AbstractContextManager
from types import FrameType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from signal import _HANDLER as Handler  # pyright: ignore[reportPrivateUsage]

ENDING = (signal.SIGINT, signal.SIGTERM)


class EndSignals(AbstractContextManager["EndSignals"]):
    """Called, it tells whether a signal has come; the second one does what it did before.

    Also where a shell has started the program in the background, and with that deaf to Ctrl-C's signal.
    """

    def __init__(self, tell: Callable[[signal.Signals], None] = lambda number: None) -> None:
        """Change nothing yet; `tell` will be told of the signal when it comes."""
        self._before: dict[signal.Signals, Handler] = {}
        self._tell, self._came = tell, False

    def __enter__(self) -> EndSignals:
        """Listen from now on; `ValueError` in another thread than the main one."""
        self._before = {number: signal.signal(number, self._note) for number in ENDING}
        return self

    def __exit__(self, *raised: object) -> None:
        """Handle signals as before."""
        before, self._before = self._before, {}
        for number, handler in before.items():
            signal.signal(number, handler)

    def __call__(self) -> bool:
        """Tell whether a signal has come."""
        return self._came

    def _note(self, number: int, frame: FrameType | None) -> None:
        self._came = True
        self.__exit__()
        self._tell(signal.Signals(number))
