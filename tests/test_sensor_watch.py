"""Laws of torque sensors that say nothing new."""

from __future__ import annotations

import numpy as np

from preshape.control.sensor_watch import SensorWatch
from preshape.control.touch import FROZEN_TICKS
from preshape.hal.layout import LAYOUT


def test_a_noisy_sensor_is_alive_and_a_frozen_one_is_named_once() -> None:
    rng, watch = np.random.default_rng(3), SensorWatch()
    thumb = LAYOUT.index("left_thumb_flex")
    for tick in range(1000):
        torque = rng.normal(0.0, 0.005, LAYOUT.dof).round(3)
        if tick > 500:
            torque[thumb] = 0.25
        named = watch.update(torque)
        assert named == (("left_thumb_flex",) if tick == 501 + FROZEN_TICKS else ())
    assert np.flatnonzero(watch.frozen).tolist() == [thumb]
    watch.update(rng.normal(0.0, 0.005, LAYOUT.dof))
    assert not watch.frozen.any()
