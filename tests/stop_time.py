"""What ruckig says is the least time of a stop, asked anew and outside the loop."""

from __future__ import annotations

from typing import Any

import numpy as np
import ruckig as untyped_ruckig

from preshape.control.smoothing import SmoothConfig
from preshape.hal.layout import LAYOUT

ruckig: Any = untyped_ruckig  # its extension module has no types


def least_stop_s(velocity: np.ndarray, acceleration: np.ndarray) -> float:
    """Return the time in which all joints can come to rest from velocities (40,) and accelerations (40,)."""
    shares, asked = SmoothConfig(), ruckig.InputParameter(LAYOUT.dof)
    asked.control_interface = ruckig.ControlInterface.Velocity
    asked.synchronization = ruckig.Synchronization.No
    asked.current_velocity, asked.current_acceleration = velocity.tolist(), acceleration.tolist()
    asked.target_velocity = [0.0] * LAYOUT.dof
    asked.max_acceleration = (shares.acceleration_ratio * LAYOUT.acceleration).tolist()
    asked.max_jerk = (shares.jerk_ratio * LAYOUT.jerk).tolist()
    trajectory = ruckig.Trajectory(LAYOUT.dof)
    assert ruckig.Ruckig(LAYOUT.dof).calculate(asked, trajectory) is ruckig.Result.Working
    return float(trajectory.duration)


def assert_stops_in_least_time(targets: np.ndarray, dt: float) -> None:
    """Check commands (n, 40): three from before the stop, then those that brake, up to rest."""
    speed = np.diff(targets, axis=0) / dt
    change = np.diff(speed, axis=0) / dt
    least_s = least_stop_s(speed[1], change[0])
    assert 0.0 < least_s
    # The grid of ticks rounds up, and rest, which is not commanded any more, shows one step later.
    assert (len(targets) - 3) * dt <= least_s + 2 * dt
    assert np.linalg.norm(speed[2]) < np.linalg.norm(speed[1])
    assert (np.abs(speed[-1]) <= LAYOUT.jerk * dt * dt).all()
    assert (np.abs(change[1:]) <= LAYOUT.acceleration * (1.0 + 1e-9)).all()
    assert (np.abs(np.diff(change, axis=0) / dt) <= LAYOUT.jerk * (1.0 + 1e-6)).all()
