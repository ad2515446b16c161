"""Obstacles that appear and move: bodies without dynamics, put where they are at each step."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray

from preshape.hal.state import Vector
from preshape.hal.transform import Matrix
from preshape.sim_backend.scenario import ObstacleSection
from preshape.sim_backend.sensors import obstacle_pose

PARKED = (50.0, 50.0, -50.0)
"""Where an obstacle waits until it appears, m: out of every body's and every ray's way."""


class MovingObstacles:
    """Places every obstacle of a scenario in a model built from it.

    `appeared_s` (obstacles,) is when each appeared, in seconds since the start; NaN: not yet.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, sections: tuple[ObstacleSection, ...]) -> None:
        """Find the bodies and put those that are there from the start where they are."""
        self._model, self._data, self._sections = model, data, sections
        bodies = [model.body(f"obstacle_{section.name}").id for section in sections]
        self._mocaps = [int(model.body_mocapid[body]) for body in bodies]
        self._geoms = [int(model.body_geomadr[body]) for body in bodies]
        # What moves by itself: the robot and the object.
        moving = model.body_weldid[model.geom_bodyid] > 0
        self._others: NDArray[np.int64] = np.flatnonzero(moving & ~np.isin(model.geom_bodyid, bodies))
        self.appeared_s: Vector = np.array([np.nan if section.appears_s else 0.0 for section in sections])
        self.any = bool(sections)
        for number in range(len(sections)):
            self._put(number, 0.0)

    def place(self, time_s: float) -> None:
        """Put each obstacle where it is at a time since the start, s."""
        for number, section in enumerate(self._sections):
            if np.isnan(self.appeared_s[number]):
                X = obstacle_pose(section, time_s, time_s)
                if time_s < section.appears_s or X is None or not self._has_room(number, X, section.room_m):
                    continue
                self.appeared_s[number] = time_s
            elif not any(section.velocity_m_per_s):
                continue
            self._put(number, time_s)

    def _put(self, number: int, time_s: float) -> None:
        X = obstacle_pose(self._sections[number], time_s, float(self.appeared_s[number]))
        mocap = self._mocaps[number]
        self._data.mocap_pos[mocap] = np.array(PARKED) * (1 + mocap) if X is None else X[:3, 3]

    def _has_room(self, number: int, X: Matrix, room_m: float) -> bool:
        """Tell whether whatever moves by itself, as it was a step ago, keeps away from an obstacle's place."""
        if not room_m:
            return True
        geom, data = self._geoms[number], self._data
        # Derived from the bodies' poses anew in the next step.
        data.geom_xpos[geom], data.geom_xmat[geom] = X[:3, 3], X[:3, :3].ravel()
        near = np.linalg.norm(data.geom_xpos[self._others] - X[:3, 3], axis=1)
        reach = self._model.geom_rbound[self._others] + self._model.geom_rbound[geom] + room_m
        return all(
            mujoco.mj_geomDistance(self._model, data, int(other), geom, room_m, None) >= room_m
            for other in self._others[near < reach]
        )
