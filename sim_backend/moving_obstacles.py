"""Obstacles that appear and move: bodies without dynamics, put where they are at each step."""

from __future__ import annotations

import mujoco
import numpy as np

from preshape.sim_backend.scenario import ObstacleSection
from preshape.sim_backend.sensors import obstacle_pose

PARKED = (50.0, 50.0, -50.0)
"""Where an obstacle waits until it appears, m: out of every body's and every ray's way."""


class MovingObstacles:
    """Places every obstacle of a scenario in a model built from it."""

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData, sections: tuple[ObstacleSection, ...]) -> None:
        """Find the bodies and put them where they are at time 0."""
        self._data = data
        self._moving = {
            int(model.body_mocapid[model.body(f"obstacle_{section.name}").id]): section for section in sections
        }
        self._there: set[int] = set()
        self.any = bool(sections)
        self.place(0.0)

    def place(self, time_s: float) -> None:
        """Put each obstacle where it is at a time since the start, s."""
        for mocap, section in self._moving.items():
            if mocap in self._there and not any(section.velocity_m_per_s):
                continue
            X = obstacle_pose(section, time_s)
            if X is not None:
                self._there.add(mocap)
            self._data.mocap_pos[mocap] = np.array(PARKED) * (1 + mocap) if X is None else X[:3, 3]
