"""How patient the driver of the hand bus is."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class CanDeviceConfig:
    """Patience of the driver.

    Attributes:
        period_s: time between two commands; without commands the modules are polled as often.
        lost_cycles: a module of which nothing is heard while more broadcasts are sent is lost; so many commands in a
            row that a bus does not take are a fault of the bus.
        arming_retry_s: an arming request without an answer is repeated after this time.
        arming_s: arming that takes longer has failed.
        silent_poll_s: time between two polls while no module answers: nothing piles up on a dead bus.
    """

    period_s: float = 0.002
    lost_cycles: int = 5
    arming_retry_s: float = 0.010
    arming_s: float = 1.0
    silent_poll_s: float = 0.1

    def __post_init__(self) -> None:
        for name in ("period_s", "lost_cycles", "arming_retry_s", "arming_s", "silent_poll_s"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name}: got {getattr(self, name)}, allowed is > 0")
