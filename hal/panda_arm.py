"""The Franka Panda arm (public kinematics and limits), with collision shapes written for this project."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class ArmJoint:
    """One revolute joint about its local z: its place in the previous link and its limits (SI)."""

    xyz: tuple[float, float, float]
    roll: float
    lower: float
    upper: float
    velocity: float
    acceleration: float
    jerk: float
    torque: float


_HALF = np.pi / 2

JOINTS: tuple[ArmJoint, ...] = (
    ArmJoint((0.0, 0.0, 0.333), 0.0, -2.8973, 2.8973, 2.1750, 15.0, 7500.0, 87.0),
    ArmJoint((0.0, 0.0, 0.0), -_HALF, -1.7628, 1.7628, 2.1750, 7.5, 3750.0, 87.0),
    ArmJoint((0.0, -0.316, 0.0), _HALF, -2.8973, 2.8973, 2.1750, 10.0, 5000.0, 87.0),
    ArmJoint((0.0825, 0.0, 0.0), _HALF, -3.0718, -0.0698, 2.1750, 12.5, 6250.0, 87.0),
    ArmJoint((-0.0825, 0.384, 0.0), -_HALF, -2.8973, 2.8973, 2.6100, 15.0, 7500.0, 12.0),
    ArmJoint((0.0, 0.0, 0.0), _HALF, -0.0175, 3.7525, 2.6100, 20.0, 10000.0, 12.0),
    ArmJoint((0.088, 0.0, 0.0), _HALF, -2.8973, 2.8973, 2.6100, 20.0, 10000.0, 12.0),
)

FLANGE_OFFSET = 0.107
"""Distance along z of link 7 from joint 7 to the flange, m."""

MASSES = (4.97, 0.65, 3.23, 3.59, 1.23, 1.67, 0.74)
"""Mass of links 1 to 7, kg (published identifications, rounded)."""


@dataclass(frozen=True, slots=True)
class ArmCapsule:
    """A capsule in one link's frame (link 0 is the pedestal): its two end points and its radius, m."""

    link: int
    start: tuple[float, float, float]
    end: tuple[float, float, float]
    radius: float


CAPSULES: tuple[ArmCapsule, ...] = (
    ArmCapsule(0, (-0.06, 0.0, 0.06), (0.0, 0.0, 0.10), 0.09),
    ArmCapsule(1, (0.0, 0.0, -0.19), (0.0, 0.0, 0.0), 0.065),
    ArmCapsule(2, (0.0, 0.0, 0.0), (0.0, -0.18, 0.0), 0.065),
    ArmCapsule(3, (0.0, 0.0, -0.12), (0.06, 0.0, 0.0), 0.065),
    ArmCapsule(4, (-0.0825, 0.09, 0.0), (0.0, 0.0, 0.0), 0.065),
    ArmCapsule(5, (0.0, 0.0, -0.22), (0.0, 0.06, -0.06), 0.060),
    ArmCapsule(6, (0.0, 0.0, 0.0), (0.088, 0.0, 0.0), 0.055),
    ArmCapsule(7, (0.0, 0.0, 0.03), (0.0, 0.0, 0.065), 0.045),
)
