"""Perforations that tear: loads from the lock constraints, points that break one after another."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from preshape.hal.compiled import compiled
from preshape.hal.state import Vector
from preshape.sim_backend.paper_box import lid_frame, perforation_arms
from preshape.sim_backend.scenario import Scenario


class Tearing:
    """The state of both perforations; `update` runs once a physics step and unlocks what has torn.

    The lid is rigid and its points equally stiff, so a hinge moment T loads the intact point at distance
    r_i from the hinge with f_i = T r_i / sum_j r_j^2. A point tears when f_i has stayed above its strength
    for the tear time; the lock goes with the last point. The tab's one perforation carries T / depth at
    its free edge.
    """

    def __init__(self, model: mujoco.MjModel, scenario: Scenario) -> None:
        """Find the locks of a model built with `add_paper_box` from the same drawn scenario."""
        strengths, frame = scenario.strengths, lid_frame(scenario)
        self._lid_arms = perforation_arms(frame, strengths.points)
        self._tab_depth = frame.tab_depth
        self._point_n = strengths.point_n * strengths.scale
        self._tab_n = strengths.tab_n * strengths.scale
        self._steps_to_tear = max(1, round(strengths.tear_time_s / model.opt.timestep))
        self._lid_lock = model.equality("lid_perforation").id
        self._tab_lock = model.equality("tab_perforation").id
        self._over = np.zeros(strengths.points, dtype=np.int64)
        self._tab_over = 0
        self.intact = np.ones(strengths.points, dtype=np.bool_)
        self.tab_torn = False
        self._arms, self._square_sum = self._lid_arms, float(self._lid_arms @ self._lid_arms)

    @property
    def torn_fraction(self) -> float:
        """Share of the lid's perforation points that have torn."""
        return 1.0 - float(self.intact.mean())

    def update(self, data: mujoco.MjData) -> None:
        """Read both locks' moments of the step just made and tear what was overloaded long enough."""
        if self.tab_torn and not self.intact.any():
            return
        tab_moment, lid_moment = _moments(data.efc_id, data.efc_force, data.ne, self._tab_lock, self._lid_lock)
        if not self.tab_torn:
            load = abs(tab_moment) / self._tab_depth
            self._tab_over = self._tab_over + 1 if load > self._tab_n else 0
            if self._tab_over >= self._steps_to_tear:
                self.tab_torn = True
                data.eq_active[self._tab_lock] = 0
        # Only an opening moment pulls on the points; pushed inward, the lid rests on the walls.
        moment = max(0.0, -lid_moment)
        if _tear(moment, self._arms, self._square_sum, self._point_n, self._steps_to_tear, self._over, self.intact):
            self._arms = self._lid_arms * self.intact
            self._square_sum = float(self._arms @ self._arms)
            if not self.intact.any():
                data.eq_active[self._lid_lock] = 0


@compiled
def _moments(ids: NDArray[Any], forces: Vector, count: int, first: int, second: int) -> tuple[float, float]:
    """Return the moments (N m) of two equality constraints, 0 for one that is not active."""
    of_first = of_second = 0.0
    for row in range(count):
        if ids[row] == first:
            of_first = forces[row]
        elif ids[row] == second:
            of_second = forces[row]
    return of_first, of_second


@compiled
def _tear(
    moment: float, arms: Vector, square_sum: float, strength: float, steps: int, over: NDArray[np.int64],
    intact: NDArray[np.bool_],
) -> bool:  # fmt: skip
    """Count for how many steps each intact point was overloaded, tear those that were long enough; tell if any did."""
    torn = False
    for point in range(len(arms)):
        if not intact[point]:
            continue
        over[point] = over[point] + 1 if moment * arms[point] / square_sum > strength else 0
        if over[point] >= steps:
            intact[point] = False
            torn = True
    return torn
