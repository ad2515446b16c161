"""The first Ctrl-C asks the loop to stop, whether it still runs or not; the second one ends the program."""

from __future__ import annotations

import signal
from collections.abc import Iterator
from typing import cast

import pytest

from preshape.control.loop import ControlLoop
from preshape.tools.stop_signals import StopSignals


class Loop:
    """Stands for the control loop: takes note of what it is asked."""

    def __init__(self) -> None:
        self.asked: list[str] = []

    def request_stop(self, reason: str) -> None:
        self.asked.append(reason)


@pytest.mark.parametrize(
    ("number", "reason"), [(signal.SIGINT, "interrupted from the keyboard"), (signal.SIGTERM, "asked to terminate")]
)
def test_a_signal_asks_the_loop_once_and_handlers_are_as_before_then(number: int, reason: str) -> None:
    loop, before = Loop(), [signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)]
    with StopSignals() as signals:
        assert [signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)] == before
        signals.obey(cast(ControlLoop, loop))
        signal.raise_signal(number)
        assert loop.asked == [reason]
        assert [signal.getsignal(each) for each in (signal.SIGINT, signal.SIGTERM)] == before


@pytest.fixture
def pythons_own() -> Iterator[None]:
    """Handle interrupts as Python does by itself: a process that has run other tests may not."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.mark.usefixtures("pythons_own")
def test_the_second_interrupt_is_pythons_own() -> None:
    loop = Loop()
    with StopSignals() as signals:
        signals.obey(cast(ControlLoop, loop))
        signal.raise_signal(signal.SIGINT)
        with pytest.raises(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
    assert loop.asked == ["interrupted from the keyboard"]


def test_without_a_signal_nothing_is_asked_and_handlers_are_restored() -> None:
    loop, before = Loop(), signal.getsignal(signal.SIGINT)
    with StopSignals() as signals:
        signals.obey(cast(ControlLoop, loop))
        assert signal.getsignal(signal.SIGINT) is not before
    assert signal.getsignal(signal.SIGINT) is before and loop.asked == []
