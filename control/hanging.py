"""How much a box hangs on the thumb of the hand that carries it: there its grip is weakest."""

from __future__ import annotations

import numpy as np

from preshape.hal.transform import Matrix


def hanging(R_world_palm: Matrix) -> float:
    """Return max(0, max_i g_i . x), 0 .. 1, over the palm's attitudes (n, 3, 3) on a way.

    g_i is the direction of gravity in the palm's frame, x the palm's axis from the fingers to the thumb.
    """
    return max(0.0, -float(np.asarray(R_world_palm)[:, 2, 0].min()))
