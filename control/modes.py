"""The modes of the loop as one table: what may follow what. Data, so that a test can walk all of it."""

from __future__ import annotations

from collections.abc import Mapping
from enum import Enum
from types import MappingProxyType


class LoopMode(Enum):
    """Where the loop is."""

    DISARMED = "disarmed"
    """Nothing is written."""
    ARMING = "arming"
    """The device has been told to arm; its answer is awaited."""
    HOLDING = "holding"
    """The position measured at arming, or the last command, is held."""
    RUNNING = "running"
    """The controller's setpoints pass the gate."""
    STOPPING = "stopping"
    """The gate brakes to rest; setpoints are ignored."""
    STOPPED = "stopped"
    """The device is stopped, latched; only ARM leads on."""


class LoopEvent(Enum):
    """What can happen to the loop."""

    ARM = "arm"
    ARMED = "armed"
    START = "start"
    FINISH = "finish"
    STOP = "stop"
    """Someone asked for a stop: brake first."""
    FAULT = "fault"
    """The gate or the device found a fault: no more motion of ours."""
    AT_REST = "at rest"
    DISARM = "disarm"


_M, _E = LoopMode, LoopEvent

MODE_TABLE: Mapping[tuple[LoopMode, LoopEvent], LoopMode] = MappingProxyType(
    {
        (_M.DISARMED, _E.ARM): _M.ARMING,
        (_M.DISARMED, _E.STOP): _M.DISARMED,
        (_M.DISARMED, _E.FAULT): _M.STOPPED,
        (_M.DISARMED, _E.DISARM): _M.DISARMED,
        (_M.ARMING, _E.ARMED): _M.HOLDING,
        (_M.ARMING, _E.STOP): _M.STOPPED,
        (_M.ARMING, _E.FAULT): _M.STOPPED,
        (_M.ARMING, _E.DISARM): _M.DISARMED,
        (_M.HOLDING, _E.START): _M.RUNNING,
        (_M.HOLDING, _E.STOP): _M.STOPPED,
        (_M.HOLDING, _E.FAULT): _M.STOPPED,
        (_M.HOLDING, _E.DISARM): _M.DISARMED,
        (_M.RUNNING, _E.FINISH): _M.HOLDING,
        (_M.RUNNING, _E.STOP): _M.STOPPING,
        (_M.RUNNING, _E.FAULT): _M.STOPPED,
        (_M.STOPPING, _E.AT_REST): _M.STOPPED,
        (_M.STOPPING, _E.STOP): _M.STOPPING,
        (_M.STOPPING, _E.FAULT): _M.STOPPED,
        (_M.STOPPED, _E.ARM): _M.ARMING,
        (_M.STOPPED, _E.STOP): _M.STOPPED,
        (_M.STOPPED, _E.FAULT): _M.STOPPED,
        (_M.STOPPED, _E.DISARM): _M.DISARMED,
    }
)
"""(mode, event) -> next mode; what is not listed is refused."""

WRITING = frozenset({LoopMode.HOLDING, LoopMode.RUNNING, LoopMode.STOPPING})
"""Modes in which commands go to the device."""


def next_mode(mode: LoopMode, event: LoopEvent) -> LoopMode:
    """Return the mode that follows; `ValueError` names the events that the mode allows."""
    try:
        return MODE_TABLE[mode, event]
    except KeyError:
        allowed = ", ".join(known.value for (at, known) in MODE_TABLE if at is mode)
        raise ValueError(f"event {event.value!r} in mode {mode.value!r}: allowed are {allowed}") from None
