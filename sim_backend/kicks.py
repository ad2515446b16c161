"""Disturbances: one push at the held box in each task listed, timed by true events."""

from __future__ import annotations

import numpy as np

from preshape.sim_backend.referee import Referee
from preshape.sim_backend.simulation import Simulation


class KickSchedule:
    """Kicks the box of a simulation as its scenario asks: force, duration, tasks; direction and delay drawn per seed.

    A task that ends before its kick was due gets it at its end, as long as the box is held: none is left out.
    """

    def __init__(self, simulation: Simulation, referee: Referee) -> None:
        """Attach to a simulation; the referee, attached before, tells the true task and whether the box is held."""
        section = simulation.scenario.disturbances
        rng = np.random.default_rng((0x51CC, simulation.scenario.seed))
        directions = rng.standard_normal((6, 3))
        self._forces = section.kick_force_n * directions / np.linalg.norm(directions, axis=1, keepdims=True)
        self._delays = rng.uniform(*section.kick_delay_s, 6)
        self._duration_s = section.kick_duration_s
        self._pending = sorted(set(section.kick_tasks)) if section.kick_force_n > 0.0 else []
        self._held_since: float | None = None
        self._simulation, self._referee = simulation, referee
        self.given: list[tuple[int, float]] = []
        """Each kick given: its task and when, s."""
        if self._pending:
            simulation.after_step.append(self._look)

    def _look(self, time_ns: int) -> None:
        if not self._pending:
            return
        task, stage = self._pending[0], self._referee.stage
        if stage < task or not self._referee.held:
            self._held_since = None
            return
        seconds = self._simulation.seconds
        if self._held_since is None:
            self._held_since = seconds
        if stage > task or seconds - self._held_since >= self._delays[task]:
            self._simulation.kick(self._forces[task], self._duration_s)
            self.given.append((task, seconds))
            self._pending.pop(0)
            self._held_since = None
