"""What a grip is: palm poses in the box's frame, finger angles before closing, and the stages of closing."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from preshape.hal.layout import HAND_DOF, Side
from preshape.hal.sah_hand import ACTUATED
from preshape.hal.state import Vector
from preshape.hal.transform import Matrix

LIGHT_SHARE = 0.3
"""Share of the squeeze with which the fingers wait for each other."""


@dataclass(frozen=True, slots=True, eq=False)
class Stage:
    """One step of closing: joints that move to angles (nan: stay), joints that are driven to torques (nan: not).

    `touch` asks that every driven joint has met something before the next stage begins.
    """

    angles: Vector
    torques: Vector
    seconds: float
    touch: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Grip:
    """A grip: palm poses in the box's frame (held, and while it comes), finger angles (13) before closing, stages.

    `torques` (13), N m: goals of the driven joints, nan where the joint keeps its angle. `opposed` names the
    pairs of fingers that press against each other: their torques are kept by closing or opening both together.
    `advance` (3,) is the direction, in the palm's frame, in which the hand comes to the object.
    """

    name: str
    side: Side
    X_box_palm: Matrix
    X_box_palm_insert: Matrix
    preshape: Vector
    stages: tuple[Stage, ...]
    torques: Vector
    opposed: tuple[tuple[str, str], ...]
    advance: Vector = field(default_factory=lambda: np.array([0.0, 0.0, 1.0]))

    @property
    def opened(self) -> dict[Side, Vector]:
        """The hand's joint angles (13), rad, when it is open, by its side."""
        return {self.side: self.preshape}


def joints(**values: float) -> Vector:
    """Return a hand vector (13), nan but for the named joints."""
    vector = np.full(HAND_DOF, np.nan)
    for name, value in values.items():
        vector[ACTUATED.index(name)] = value
    return vector
