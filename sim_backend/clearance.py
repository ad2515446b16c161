"""How far one set of geoms is from another, only as far as a threshold needs it."""

from __future__ import annotations

import mujoco
import numpy as np
from numpy.typing import NDArray


class Clearance:
    """Tells whether two sets of geoms are apart by a distance: bounding spheres first, exact for what is left."""

    def __init__(self, model: mujoco.MjModel, first: NDArray[np.int64], second: NDArray[np.int64]) -> None:
        """Watch the pairs of two sets of geom ids."""
        self._model = model
        self._first, self._second = first, second
        self._reach = model.geom_rbound[first][:, None] + model.geom_rbound[second][None, :]

    def exceeds(self, data: mujoco.MjData, distance_m: float) -> bool:
        """Tell whether every pair is at least this far apart, with the body poses in `data`."""
        gap = data.geom_xpos[self._first][:, None, :] - data.geom_xpos[self._second][None, :, :]
        near = np.argwhere(np.linalg.norm(gap, axis=2) - self._reach < distance_m)
        return all(
            mujoco.mj_geomDistance(
                self._model, data, int(self._first[i]), int(self._second[j]), distance_m + 1e-3, None
            )
            >= distance_m
            for i, j in near
        )
