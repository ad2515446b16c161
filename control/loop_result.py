"""What a run of the loop is limited by, and how it ended."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from preshape.control.timing import TimingReport


class LoopOutcome(Enum):
    """How a run ended."""

    FINISHED = "finished"
    TIME_UP = "time up"
    STOPPED = "stopped"
    SAFETY_STOP = "safety stop"


@dataclass(frozen=True, slots=True, kw_only=True)
class LoopConfig:
    """Limits of one run.

    Attributes:
        rate_hz: ticks per second; the gate's period must be its inverse.
        max_ticks: the run ends TIME_UP after so many controller ticks.
        arming_s: the device must be ARMED within this time.
        refused_ticks: so many refused writes in a row are a fault.
        stopping_s: braking that takes longer becomes a safety stop.
    """

    rate_hz: float = 500.0
    max_ticks: int = 100_000
    arming_s: float = 2.0
    refused_ticks: int = 25
    stopping_s: float = 2.0

    def __post_init__(self) -> None:
        for name in ("rate_hz", "max_ticks", "arming_s", "refused_ticks", "stopping_s"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}: got {getattr(self, name)}, allowed is > 0")


@dataclass(frozen=True, slots=True)
class LoopResult:
    """How a run ended, why, and what it did: `commands_sha256` is over position + torque limit of every write."""

    outcome: LoopOutcome
    reason: str
    ticks: int
    written: int
    refused: int
    commands_sha256: str
    timing: TimingReport
