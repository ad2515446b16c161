"""Physics and controller in one process, in turns: deterministic, as fast as the machine goes."""

from __future__ import annotations

from preshape.sim_backend.simulation import STEP_NS, Simulation


class SimClock:
    """`preshape.hal.clock.Clock` that is the simulation: waiting steps it."""

    def __init__(self, simulation: Simulation) -> None:
        """Read and advance a simulation's time."""
        self._simulation = simulation

    def now_ns(self) -> int:
        """Return the simulated time."""
        return self._simulation.time_ns

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """Step the simulation to the first step at or after the deadline."""
        remaining = deadline_ns - self._simulation.time_ns
        if remaining > 0:
            self._simulation.step(-(-remaining // STEP_NS))
