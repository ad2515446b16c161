"""What the physics process, the camera process and the controller's process tell each other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from preshape.hal.layout import LAYOUT
from preshape.hal.transform import Matrix
from preshape.hal.world import Face
from preshape.sim_backend.referee_report import Verdict
from preshape.sim_backend.scenario import Scenario

PHYSICS = "physics"
"""Name of the process that steps a scene in real time."""
COMMAND = np.dtype(
    [
        ("sequence", np.int64),
        ("mode", np.int64),
        ("position", np.float64, (LAYOUT.dof,)),
        ("torque_limit", np.float64, (LAYOUT.dof,)),
        ("torque", np.float64, (LAYOUT.dof,)),
    ]
)
"""The newest command."""


def state_record(model: mujoco.MjModel) -> np.dtype[Any]:
    """Return the record that the physics publishes every step; times in ns on the machine's monotonic clock.

    `scene_ns` counts from the start of the simulation; a pose stamp of -1 says that no sample has arrived, and
    `appeared_s` since when each obstacle has been there (NaN: not yet).
    """
    return np.dtype(
        [
            ("scene_ns", np.int64),
            ("now_ns", np.int64),
            ("sequence", np.int64),
            ("status", np.int64),
            ("fault", "S80"),
            ("position", np.float64, (LAYOUT.dof,)),
            ("velocity", np.float64, (LAYOUT.dof,)),
            ("torque", np.float64, (LAYOUT.dof,)),
            ("stamp_ns", np.int64),
            ("pose_stamp_ns", np.int64),
            ("X_world_box", np.float64, (4, 4)),
            ("qpos", np.float64, (model.nq,)),
            ("mocap_pos", np.float64, (max(1, model.nmocap), 3)),
            ("appeared_s", np.float64, (max(1, model.nmocap),)),
        ]
    )


@dataclass(frozen=True, slots=True)
class Open:
    """Open the device; answered with an empty text."""


@dataclass(frozen=True, slots=True)
class Arm:
    """Arm the device; answered with the cause of a refusal, or an empty text."""


@dataclass(frozen=True, slots=True)
class Stop:
    """Latch a stop; not answered."""

    reason: str


@dataclass(frozen=True, slots=True)
class Close:
    """Close the device; answered with an empty text."""


@dataclass(frozen=True, slots=True, eq=False)
class ReportOpening:
    """Tell the referee the opening that was found; not answered."""

    face: Face
    edge: Face
    offset: float
    X_world_box: Matrix


@dataclass(frozen=True, slots=True)
class FreezeTorque:
    """Break the torque sensors of some joints; not answered."""

    first: int
    last: int


@dataclass(frozen=True, slots=True)
class Describe:
    """Ask what is simulated; answered with `Described`."""


@dataclass(frozen=True, slots=True)
class Described:
    """The drawn scenario, and how many of its seconds pass in each of the machine's."""

    scenario: Scenario
    pace: float


@dataclass(frozen=True, slots=True)
class Finish:
    """End the process; answered with `Finished`."""


@dataclass(frozen=True, slots=True)
class Finished:
    """The referee's verdict, how long was simulated, and how well real time was kept.

    `slipped_s` is the time by which the scene stood still because the machine did not run the physics;
    `kicks` are the disturbances given (task, s).
    """

    verdict: Verdict
    simulated_s: float
    slipped_s: float
    slips: int
    kicks: tuple[tuple[int, float], ...]


Request = Open | Arm | Stop | Close | ReportOpening | FreezeTorque | Describe | Finish
