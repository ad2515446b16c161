"""The order, names, groups and limits of the robot's 40 actuated joints: nobody indexes joints by number."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from preshape.hal import panda_arm, sah_hand

Side = Literal["right", "left"]
SIDES: tuple[Side, Side] = ("right", "left")

ARM_DOF = len(panda_arm.JOINTS)
HAND_DOF = len(sah_hand.ACTUATED)

FINGER_ACCELERATION = 60.0
"""Acceleration limit of every finger joint, rad/s2 (E)."""
FINGER_JERK = 3000.0
"""Jerk limit of every finger joint, rad/s3 (E)."""


def _frozen(values: list[float]) -> NDArray[np.float64]:
    array = np.array(values)
    array.setflags(write=False)
    return array


@dataclass(frozen=True, slots=True, eq=False)
class Layout:
    """Slices into every 40-vector of joint quantities, and the limits in that order (SI, read-only).

    Order: right arm (7), right hand (13), left arm (7), left hand (13); each hand thumb (opp, abd,
    flex, pip), fore, middle, ring (abd, flex, pip each).
    """

    names: tuple[str, ...]
    lower: NDArray[np.float64]
    upper: NDArray[np.float64]
    velocity: NDArray[np.float64]
    acceleration: NDArray[np.float64]
    jerk: NDArray[np.float64]
    torque: NDArray[np.float64]
    dof: int = field(init=False)
    """Number of actuated joints."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "dof", len(self.names))

    def arm(self, side: Side) -> slice:
        """Return the slice of one arm's 7 joints."""
        start = SIDES.index(side) * (ARM_DOF + HAND_DOF)
        return slice(start, start + ARM_DOF)

    def hand(self, side: Side) -> slice:
        """Return the slice of one hand's 13 joints."""
        start = self.arm(side).stop
        return slice(start, start + HAND_DOF)

    def finger(self, side: Side, finger: str) -> slice:
        """Return the slice of one finger: 4 joints for the thumb, 3 for the others."""
        local = finger_slice(finger)
        start = self.hand(side).start
        return slice(start + local.start, start + local.stop)

    def part(self, name: str) -> slice:
        """Return the slice of a joint, or of a finger (`right_thumb`), by its name; `KeyError` names the valid ones."""
        fingers = {f"{side}_{finger}": self.finger(side, finger) for side in SIDES for finger in sah_hand.FINGERS}
        if name in fingers:
            return fingers[name]
        if name not in self.names:
            raise KeyError(f"part {name!r} is none of {', '.join((*fingers, *self.names))}")
        index = self.names.index(name)
        return slice(index, index + 1)

    def index(self, name: str) -> int:
        """Return the index of a joint by its name; `KeyError` names the valid ones."""
        if name not in self.names:
            raise KeyError(f"joint {name!r} is none of {', '.join(self.names)}")
        return self.names.index(name)


def finger_slice(finger: str) -> slice:
    """Return the slice of one finger inside a hand's 13-vector."""
    if finger not in sah_hand.FINGERS:
        raise KeyError(f"finger {finger!r} is none of {', '.join(sah_hand.FINGERS)}")
    if finger == "thumb":
        return slice(0, 4)
    start = 4 + 3 * sah_hand.FOREFINGERS.index(finger)
    return slice(start, start + 3)


def arm_joint_names(side: Side) -> tuple[str, ...]:
    """Return the seven joint names of one arm."""
    return tuple(f"{side}_arm_{number + 1}" for number in range(ARM_DOF))


def hand_joint_names(side: Side) -> tuple[str, ...]:
    """Return the 13 actuated joint names of one hand."""
    return tuple(f"{side}_{name}" for name in sah_hand.ACTUATED)


def _build() -> Layout:
    hand = [joint for joint in sah_hand.JOINTS if joint.coupled_to is None]
    arm = panda_arm.JOINTS
    return Layout(
        names=tuple(name for side in SIDES for name in (*arm_joint_names(side), *hand_joint_names(side))),
        lower=_frozen(2 * ([j.lower for j in arm] + [j.lower for j in hand])),
        upper=_frozen(2 * ([j.upper for j in arm] + [j.upper for j in hand])),
        velocity=_frozen(2 * ([j.velocity for j in arm] + [sah_hand.VELOCITY_LIMIT] * HAND_DOF)),
        acceleration=_frozen(2 * ([j.acceleration for j in arm] + [FINGER_ACCELERATION] * HAND_DOF)),
        jerk=_frozen(2 * ([j.jerk for j in arm] + [FINGER_JERK] * HAND_DOF)),
        torque=_frozen(2 * ([j.torque for j in arm] + [j.torque for j in hand])),
    )


LAYOUT = _build()
"""The layout of this robot; one value for the whole program."""
