"""What simulated joint modules did until they were switched off."""

from __future__ import annotations

from dataclasses import dataclass

from preshape.sim_backend.joint_module import ModuleEvent


@dataclass(frozen=True, slots=True)
class ModulesLog:
    """Their changes of state by time, and the largest share of a torque limit in physics.

    The share is what lasted for 10 ms, as the referee takes it; None where there is no referee.
    """

    events: list[ModuleEvent]
    max_torque_ratio: float | None = None
