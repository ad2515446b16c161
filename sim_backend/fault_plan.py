"""What is to go wrong on a bus: a chance for each frame, and events at their times. Pure values."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from enum import Enum

LONGEST_DELAY_S = 1.0
"""Frames are held back for no longer than this, s."""
LAST_TASK = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class FrameFaults:
    """What may happen to each frame, each by a draw of its own.

    Attributes:
        drop: chance that the frame is lost.
        duplicate: chance that it comes twice.
        reorder: chance that it comes after the frame that follows it.
        corrupt: chance that one to three of its data bits are turned over.
        delay_s: how long every frame is held back, s.
        jitter_s: how much longer at most, drawn uniformly, s.

    Raises:
        ValueError: on construction, for a chance or a time out of range.
    """

    drop: float = 0.0
    duplicate: float = 0.0
    reorder: float = 0.0
    corrupt: float = 0.0
    delay_s: float = 0.0
    jitter_s: float = 0.0

    def __post_init__(self) -> None:
        for name in CHANCES:
            if not 0.0 <= getattr(self, name) <= 1.0:
                raise ValueError(f"{name}: got {getattr(self, name):g}, allowed is 0 .. 1")
        for name in ("delay_s", "jitter_s"):
            if not 0.0 <= getattr(self, name) <= LONGEST_DELAY_S:
                raise ValueError(f"{name}: got {getattr(self, name):g}, allowed is 0 .. {LONGEST_DELAY_S:g}")

    @property
    def any(self) -> bool:
        """Whether anything can happen to a frame."""
        return any(getattr(self, entry.name) > 0.0 for entry in fields(self))


CHANCES = ("drop", "duplicate", "reorder", "corrupt")


class FaultKind(Enum):
    """What can happen once."""

    BUS_OFF = "bus_off"
    """The controller's node is off the bus: nothing passes in either direction."""
    NODE_DEATH = "node_death"
    """A module loses its power; with an end it starts anew then, as after any power-up."""
    TORQUE_FREEZE = "torque_freeze"
    """A module goes on reporting the torques that it measured at the beginning."""
    TORQUE_DRIFT = "torque_drift"
    """The torques that a module reports drift away from those it measures."""
    HOST_STALL = "host_stall"
    """The controller's process stands still."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultEvent:
    """One thing that goes wrong, and when.

    Attributes:
        kind: what happens.
        target: name of the module, of the bus for BUS_OFF, empty for HOST_STALL.
        task: it begins `after_s` after the beginning of this task; 0: of the run.
        after_s: s.
        lasts_s: how long it lasts, s; infinite: to the end of the run.
        rate: of TORQUE_DRIFT, N m/s.

    Raises:
        ValueError: on construction, for a value out of range.
    """

    kind: FaultKind
    target: str = ""
    task: int = 0
    after_s: float = 0.0
    lasts_s: float = math.inf
    rate: float = 0.0

    def __post_init__(self) -> None:
        if not 0 <= self.task <= LAST_TASK:
            raise ValueError(f"{self.kind.value}: got task {self.task}, allowed is 0 .. {LAST_TASK}")
        if not 0.0 <= self.after_s < math.inf:
            raise ValueError(f"{self.kind.value}: got {self.after_s:g} s after its task began, allowed is >= 0")
        if not self.lasts_s > 0.0:
            raise ValueError(f"{self.kind.value}: got {self.lasts_s:g} s long, allowed is > 0")
        if self.kind is FaultKind.HOST_STALL and not math.isfinite(self.lasts_s):
            raise ValueError(f"{self.kind.value}: got no end, allowed is a time > 0")
        if not math.isfinite(self.rate) or (self.kind is FaultKind.TORQUE_DRIFT) != (self.rate != 0.0):
            raise ValueError(f"{self.kind.value}: got {self.rate:g} N m/s, allowed is not 0 for torque_drift, else 0")


@dataclass(frozen=True, slots=True, kw_only=True)
class FaultPlan:
    """All that is to go wrong in one run."""

    frames: FrameFaults = field(default_factory=FrameFaults)
    events: tuple[FaultEvent, ...] = ()

    @property
    def any(self) -> bool:
        """Whether anything is to go wrong."""
        return self.frames.any or bool(self.events)
