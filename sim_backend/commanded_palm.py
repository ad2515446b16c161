"""Where a palm would be if its arm followed its commands exactly: what a held box's motion is measured against."""

from __future__ import annotations

import mujoco
import numpy as np

from preshape.hal.layout import Side
from preshape.hal.transform import Matrix, transform
from preshape.sim_backend.drives import JointDrives
from preshape.sim_backend.robot_model import joint_addresses


class CommandedPalm:
    """Forward kinematics of the drives' targets, in a state of its own: the simulation is not touched."""

    def __init__(self, model: mujoco.MjModel, drives: JointDrives, side: Side) -> None:
        """Take a simulation's model and drives."""
        self._model, self._drives = model, drives
        self._data = mujoco.MjData(model)
        self._qpos = joint_addresses(model)[0]
        self._body = model.body(f"{side}_palm").id

    def pose(self) -> Matrix:
        """Return X_world_palm at the present targets."""
        self._data.qpos[self._qpos] = self._drives.targets
        mujoco.mj_kinematics(self._model, self._data)
        rotation = np.asarray(self._data.xmat[self._body]).reshape(3, 3)
        return transform(self._data.xpos[self._body], rotation)
