"""What a way costs the grip of the hand that carries a box: gravity turns in the palm's frame, and the box slides."""

from __future__ import annotations

import numpy as np

from preshape.hal.transform import Matrix

HANGING_RAD = 2.0
"""What a box that hangs on the thumb alone costs, rad of gravity's way in the palm's frame.

Measured with friction of 0.4: 0.6 mm of slip for each radian, and a box dropped where it hung on the thumb.
"""


def swing(R_world_palm: Matrix) -> float:
    """Return sum_i |g_i+1 - g_i| + HANGING_RAD max(0, max_i g_i . x), rad, of the palm's attitudes (n, 3, 3) on a way.

    g_i is the direction of gravity in the palm's frame, x the palm's axis from the fingers to the thumb.
    """
    down = -np.asarray(R_world_palm)[:, 2, :]
    turned = float(np.linalg.norm(np.diff(down, axis=0), axis=1).sum())
    return turned + HANGING_RAD * max(0.0, float(down[:, 0].max()))
