"""Opposed fingers as tables, and the law that presses them together; compiled, for it runs in every tick of a hold."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from preshape.hal.compiled import compiled
from preshape.hal.layout import HAND_DOF, finger_slice
from preshape.hal.state import Vector

Indices = NDArray[np.int64]
Flags = NDArray[np.bool_]

HOLDING_GAIN = 0.5
"""Joint speed per missing torque while holding, rad/s/(N m)."""
HOLDING_SPEED = 0.25
"""Largest joint speed while holding, rad/s."""


class Opposition(NamedTuple):
    """Each pair's joints (pairs, 13): the first `driven` of a row are used, the first `told` tell its squeeze."""

    joints: Indices
    driven: Indices
    told: Indices


def opposition(pairs: Sequence[tuple[str, str]], goal: Vector) -> Opposition:
    """Return the tables of pairs of opposed fingers whose joints are driven where the goal (13), N m, is not 0.

    The thumb presses alone on its side: its torque tells the squeeze of the whole grip.
    """
    joints = np.zeros((len(pairs), HAND_DOF), dtype=np.int64)
    driven, told = np.zeros(len(pairs), dtype=np.int64), np.zeros(len(pairs), dtype=np.int64)
    for number, pair in enumerate(pairs):
        own = [j for finger in pair for j in range(*finger_slice(finger).indices(HAND_DOF)) if goal[j] != 0.0]
        joints[number, : len(own)] = own
        driven[number] = len(own)
        told[number] = min(1, len(own)) if pair[0] == "thumb" else len(own)
    return Opposition(joints, driven, told)


@compiled
def press(
    fingers: Opposition, goal: Vector, torque: Vector, usable: Flags, dt: float, lower: Vector, upper: Vector,
    target: Vector,
) -> None:  # fmt: skip
    """Close or open opposed fingers together by their common lack of torque; what they share is left stiff.

    With L = mean(1 - tau / tau_goal) over the joints that tell, every driven joint of the pair turns by
    k L tau_goal dt, cut to a speed. A pair with a joint that is not usable keeps its targets (13), rad. Driving each
    joint to its own goal would let the object float between them: any load would push it along.
    """
    for pair in range(len(fingers.driven)):
        count, told = fingers.driven[pair], fingers.told[pair]
        can = told > 0
        for k in range(count):
            can = can and usable[fingers.joints[pair, k]]
        if not can:
            continue
        lack = 0.0
        for k in range(told):
            j = fingers.joints[pair, k]
            lack += 1.0 - torque[j] / goal[j]
        lack /= told
        for k in range(count):
            j = fingers.joints[pair, k]
            step = min(max(HOLDING_GAIN * lack * goal[j], -HOLDING_SPEED), HOLDING_SPEED) * dt
            target[j] = min(max(target[j] + step, lower[j]), upper[j])
