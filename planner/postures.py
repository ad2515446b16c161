"""Hand postures (13,) rad in layout order: what a hand returns to, and where a search for a preshape starts."""

from __future__ import annotations

import numpy as np

from preshape.hal.transform import Matrix


def posture(thumb: tuple[float, float, float, float], fingers: tuple[float, float, float]) -> Matrix:
    """Return joints from the thumb's (opp, abd, flex, pip) and one (abd, flex, pip) for fore, middle and ring."""
    joints = np.array([*thumb, *fingers * 3])
    joints.setflags(write=False)
    return joints


PRESHAPE = posture((1.571, 0.0, 0.2, 0.4), (0.0, 0.1, 0.8))
"""Thumb opposed, fingers arched: the palm comes close to the object and hardly tilts."""

STRAIGHT = posture((1.571, 0.0, 0.1, 0.1), (0.0, 0.1, 0.1))
"""Thumb opposed, fingers straight: a wide grasp by the pads, the palm tilts towards the thumb."""

HALF = posture((1.3, 0.0, 0.3, 0.3), (0.0, 0.3, 0.3))
"""Everything half bent."""

PINCH = posture((1.4, 0.0, 0.6, 0.6), (0.0, 0.7, 0.7))
"""Thumb and fingers nearly meeting."""

WIDE = posture((1.45, 0.25, -0.069, 0.07), (0.26, -0.069, 0.07))
"""As wide as the hand opens, everything abducted to one side."""

WIDE_BACK = posture((1.5, -0.26, -0.069, 0.07), (-0.26, -0.069, 0.07))
"""As wide as the hand opens, everything abducted to the other side."""

START_POSTURES: tuple[Matrix, ...] = (PRESHAPE, STRAIGHT, HALF, PINCH, WIDE, WIDE_BACK)
"""Where the search starts again, in this order."""

WIDE_POSTURES: tuple[Matrix, ...] = (WIDE, WIDE_BACK)
"""Where it starts last, with the palm yawed by each of `WIDE_YAWS`."""

WIDE_YAWS = (-0.5, 0.5)
"""Yaws of the palm, rad."""
