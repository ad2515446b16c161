"""What the world's side of a run knows when it is over."""

from __future__ import annotations

from dataclasses import dataclass

from preshape.sim_backend.referee_report import Verdict


@dataclass(frozen=True, slots=True, eq=False)
class Ended:
    """What the world's side knows when a run is over.

    `slipped_s`: time by which a paced scene stood still because the machine did not run it; `kicks`: each
    disturbance given, (task, s).
    """

    verdict: Verdict
    simulated_s: float
    slipped_s: float = 0.0
    kicks: tuple[tuple[int, float], ...] = ()


@dataclass(frozen=True, slots=True)
class Lost:
    """What is left of a run whose world was lost, and the referee with it: how, and how long the run has lasted."""

    how: str
    simulated_s: float
