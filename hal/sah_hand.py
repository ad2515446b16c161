"""The SCHUNK Anthropomorphic Hand: 13 actuators, 17 joints, 18 rigid parts, as plain numbers.

Right hand, SI units. Palm frame: +z towards the fingers, +x the grasp side, +y the thumb side.
The left hand is the mirror image in y. Entries marked (E) are estimates, not published figures.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

FINGERS = ("thumb", "fore", "middle", "ring")
FOREFINGERS = FINGERS[1:]

TIP_OFFSET = 0.0295
"""Distance along x of the distal link's frame from the distal joint to the fingertip frame, m."""

TIP_RADIUS = 0.0125
"""Radius of the distal capsule, m: a fingertip's surface lies this far from the tip frame's axis."""


@dataclass(frozen=True, slots=True)
class Shape:
    """A box (`size` = half edges) or a capsule along x (`size` = radius, x from, x to) of one part."""

    kind: Literal["box", "capsule"]
    center: tuple[float, float, float]
    size: tuple[float, float, float]

    def bounding_box(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return the centre and the half edges, in the part's frame, m."""
        if self.kind == "box":
            return np.array(self.center), np.array(self.size)
        radius, start, end = self.size
        center = np.array(self.center) + [(start + end) / 2, 0.0, 0.0]
        return center, np.array([(end - start) / 2 + radius, radius, radius])


@dataclass(frozen=True, slots=True)
class HandJoint:
    """One revolute joint: its place in the parent part, its axis, limits and drive.

    `coupled_to` names the joint whose angle this one repeats (1:1); such a joint has no actuator.
    """

    name: str
    parent: str
    child: str
    xyz: tuple[float, float, float]
    rpy: tuple[float, float, float]
    axis: tuple[float, float, float]
    lower: float
    upper: float
    torque: float
    coupled_to: str | None = None


_SHAPES = {
    "base": (Shape("box", (0.004, 0.0, 0.0), (0.0165, 0.0125, 0.0195)), 0.06),
    "prox": (Shape("capsule", (0.0, -0.002, 0.0), (0.018, 0.014, 0.0555)), 0.12),
    "mid": (Shape("capsule", (0.0, 0.0, 0.0), (0.0145, 0.004, 0.027)), 0.04),
    "dist": (Shape("capsule", (0.0, 0.0, 0.0), (TIP_RADIUS, 0.001, 0.0268)), 0.03),
}

PARTS: dict[str, tuple[Shape, float]] = {
    "palm": (Shape("box", (-0.008, 0.0, 0.064), (0.030, 0.058, 0.066)), 0.95),
    "thumb_opp": (Shape("box", (-0.004, 0.070, 0.052), (0.0205, 0.028, 0.035)), 0.25),
    **{f"{finger}_{link}": _SHAPES[link] for finger in FINGERS for link in _SHAPES},
}
"""Part name -> (collision shape, mass in kg (E)); 18 parts in the paper's order b1 .. b18."""

VELOCITY_LIMIT = np.pi
"""Joint speed limit of every finger joint, rad/s (E)."""

TORQUE_RANGE = 2.0
"""Range of every joint torque sensor, +- N m (E)."""

TORQUE_RESOLUTION = 1e-3
"""Resolution of every joint torque sensor, N m (E)."""

POSITION_RESOLUTION = np.deg2rad(0.1)
"""Resolution of every joint angle, rad (DLR Hand II, as a proxy)."""


def _finger(
    name: str, parent: str, xyz: tuple[float, float, float], rpy: tuple[float, float, float]
) -> list[HandJoint]:
    """Return the abduction, flexion, middle and coupled distal joint of one finger."""
    z = (0.0, 0.0, 1.0)
    straight = (0.0, 0.0, 0.0)
    return [
        HandJoint(f"{name}_abd", parent, f"{name}_base", xyz, rpy, z, -0.2618, 0.2618, 1.3),
        HandJoint(
            f"{name}_flex", f"{name}_base", f"{name}_prox", straight, (np.pi / 2, 0.0, 0.0), z, -0.0698, 1.309, 1.3
        ),
        HandJoint(f"{name}_pip", f"{name}_prox", f"{name}_mid", (0.0678, 0.0, 0.0), straight, z, 0.0698, 1.309, 0.9),
        HandJoint(
            f"{name}_dip",
            f"{name}_mid",
            f"{name}_dist",
            (0.030, 0.0, 0.0),
            straight,
            z,
            0.0698,
            1.309,
            0.9,
            f"{name}_pip",
        ),
    ]


JOINTS: tuple[HandJoint, ...] = (
    HandJoint(
        "thumb_opp", "palm", "thumb_opp", (-0.003, 0.0271, 0.0), (0.0, 0.0, 0.0), (0.0, 0.0, -1.0), 0.0, 1.571, 1.5
    ),
    *_finger("thumb", "thumb_opp", (-0.006, 0.0869, 0.0970), (0.0, -0.959927, np.pi / 2)),
    # Fore and ring diverge by 2 degrees, as on the palm's mesh.
    *_finger("fore", "palm", (-0.0043, 0.040165, 0.14545), (-np.pi / 2, -1.6051, -np.pi / 2)),
    *_finger("middle", "palm", (-0.0043, 0.0, 0.15015), (-np.pi, -np.pi / 2, 0.0)),
    *_finger("ring", "palm", (-0.0043, -0.040165, 0.14543), (np.pi / 2, -1.6051, np.pi / 2)),
)
"""All 17 joints, parents before children."""

ACTUATED: tuple[str, ...] = tuple(joint.name for joint in JOINTS if joint.coupled_to is None)
"""The 13 actuated joints: thumb opp, abd, flex, pip, then abd, flex, pip of fore, middle, ring."""
