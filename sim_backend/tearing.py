"""Perforations that tear: loads from the lock constraints, points that break one after another."""

from __future__ import annotations

import mujoco
import numpy as np

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
        self.intact = np.ones(strengths.points, dtype=bool)
        self.tab_torn = False

    @property
    def torn_fraction(self) -> float:
        """Share of the lid's perforation points that have torn."""
        return 1.0 - float(self.intact.mean())

    def update(self, data: mujoco.MjData) -> None:
        """Read both locks' moments of the step just made and tear what was overloaded long enough."""
        if self.tab_torn and not self.intact.any():
            return
        moments = _lock_moments(data)
        if not self.tab_torn:
            load = abs(moments.get(self._tab_lock, 0.0)) / self._tab_depth
            self._tab_over = self._tab_over + 1 if load > self._tab_n else 0
            if self._tab_over >= self._steps_to_tear:
                self.tab_torn = True
                data.eq_active[self._tab_lock] = 0
        if self.intact.any():
            # Only an opening moment pulls on the points; pushed inward, the lid rests on the walls.
            moment = max(0.0, -moments.get(self._lid_lock, 0.0))
            arms = self._lid_arms * self.intact
            loads = moment * arms / (arms @ arms)
            self._over = np.where(loads > self._point_n, self._over + 1, 0)
            self.intact &= self._over < self._steps_to_tear
            if not self.intact.any():
                data.eq_active[self._lid_lock] = 0


def _lock_moments(data: mujoco.MjData) -> dict[int, float]:
    """Return the moment (N m) of every active equality constraint, by its id."""
    count = data.ne
    ids, forces = data.efc_id[:count], data.efc_force[:count]
    return {int(i): float(f) for i, f in zip(ids, forces, strict=True)}
