"""How many fingers grasp a preshaping box, and where on its preshape faces their tips go (sections III-C, III-D)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from preshape.hal import sah_hand
from preshape.hal.layout import Side
from preshape.hal.transform import Matrix
from preshape.planner.hand_kinematics import hand_kinematics

RING_GAP_MIN = 0.046
"""The ring finger meets the thumb only across a larger gap of tip frames than this, m."""

EDGE = 0.010
"""Least distance of a fingertip's contact from the side edge of its face, m."""

SPACING = 0.0402
"""Distance of neighbouring fingers at rest (of their base joints), m."""

SPACING_MIN = 0.036
"""Least distance of neighbouring fingertips (the proximal links' width), m."""

_CAPSULE_END = sah_hand.PARTS["thumb_dist"][0].size[2]

TIP_SIDE = float(np.sqrt(sah_hand.TIP_RADIUS**2 - (sah_hand.TIP_OFFSET - _CAPSULE_END) ** 2))
"""Distance of the fingertip's surface from the tip frame, square to the finger, m.

The tip frame lies a little beyond the centre of the capsule's end.
"""


def fingers_for(half: ArrayLike) -> tuple[str, ...]:
    """Return thumb + fore, + middle, + ring by the preshaping box's half edges (3,), m.

    A finger is added while its contact still lies `EDGE` inside the face's width (y); the ring needs a gap
    (x, between tip frames) above `RING_GAP_MIN` as well. A lying tea box's end section (67 mm) takes two
    fingers against the thumb.
    """
    x, y, _ = np.asarray(half, float)
    room = 2.0 * (y - EDGE)
    if room >= 2.0 * SPACING and 2.0 * (x + TIP_SIDE) > RING_GAP_MIN:
        return sah_hand.FINGERS
    return sah_hand.FINGERS[:3] if room >= SPACING_MIN else sah_hand.FINGERS[:2]


def tip_targets(half: ArrayLike, fingers: tuple[str, ...], side: Side) -> Matrix:
    """Return p_fid of eq. (4) in the PB's frame (n, 3), m: the grasping plane then has the PB's pose.

    Each tip frame lies `TIP_SIDE` outside its preshape face, so the fingertip's surface lies on the face. The
    thumb is opposite the centre of the other tips; these keep the offsets along z that the fingers' lengths
    give them. On the left hand the fore finger is at -y.
    """
    half = np.asarray(half, float)
    others = fingers[1:]
    if fingers[0] != "thumb" or not 1 <= len(others) <= 3 or others != sah_hand.FOREFINGERS[: len(others)]:
        raise ValueError(f"fingers {fingers} are none of thumb + fore, + middle, + ring")
    x = half[0] + TIP_SIDE
    gap = min(SPACING, max(SPACING_MIN, 2.0 * (half[1] - EDGE) / max(1, len(others) - 1)))
    y = gap * (np.arange(len(others))[::-1] - (len(others) - 1) / 2.0) * (1.0 if side == "right" else -1.0)
    z = np.zeros(len(others))
    if len(others) == 3:
        kinematics = hand_kinematics(side)
        rest = kinematics.tips(np.clip(np.zeros(len(kinematics.lower)), kinematics.lower, kinematics.upper))[0][1:, 2]
        # Fore and ring differ by some 20 um; their mean keeps the segment between them parallel to y.
        z = (rest + rest[::-1]) / 2.0 - rest.mean()
    return np.vstack([[x, 0.0, 0.0], np.column_stack([np.full(len(others), -x), y, z])])
