"""Laws of touch from joint torque."""

from __future__ import annotations

import numpy as np
import pytest

from preshape.control.touch import BIAS_TICKS, FROZEN_TICKS, TOUCH_NM, TOUCH_TICKS, TouchSense
from preshape.hal.layout import HAND_DOF


def sensed(torques: np.ndarray) -> TouchSense:
    sense = TouchSense()
    for torque in torques:
        sense.update(torque)
    return sense


def noisy(ticks: int, seed: int = 0, sigma: float = 0.01, bias: float = 0.3) -> np.ndarray:
    return bias + np.random.default_rng(seed).normal(0.0, sigma, (ticks, HAND_DOF))


@pytest.mark.parametrize("seed", range(5))
def test_noise_about_a_bias_is_no_touch(seed: int) -> None:
    assert not sensed(noisy(5_000, seed)).touching.any()


@pytest.mark.parametrize("joint", range(HAND_DOF))
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_a_lasting_residual_touches_that_joint_alone_after_its_ticks(joint: int, sign: float) -> None:
    torques = np.zeros((BIAS_TICKS + TOUCH_TICKS, HAND_DOF))
    torques[BIAS_TICKS:, joint] = sign * 1.01 * TOUCH_NM
    assert not sensed(torques[:-1]).touching.any()
    assert np.flatnonzero(sensed(torques).touching).tolist() == [joint]


def test_a_spike_shorter_than_the_debounce_is_no_touch_however_often_it_comes() -> None:
    torques = np.zeros((BIAS_TICKS + 100 * TOUCH_TICKS, HAND_DOF))
    torques[BIAS_TICKS:][np.arange(100 * TOUCH_TICKS) % TOUCH_TICKS != 0] = 1.0
    assert not sensed(torques).touching.any()


def test_a_touch_is_kept_until_reset_which_takes_the_bias_anew() -> None:
    torques = np.zeros((BIAS_TICKS + TOUCH_TICKS, HAND_DOF))
    torques[BIAS_TICKS:] = 0.5
    sense = sensed(torques)
    sense.update(np.zeros(HAND_DOF))
    assert sense.touching.all()
    sense.reset()
    assert not sense.touching.any()
    for torque in noisy(200, bias=0.5):
        sense.update(torque)
    assert not sense.touching.any()


def test_a_value_that_never_changes_is_a_dead_sensor_and_a_living_one_is_not() -> None:
    torques = noisy(FROZEN_TICKS + 1)
    torques[:, 4] = 0.123
    assert not sensed(torques[:-1]).frozen.any()
    sense = sensed(torques)
    assert np.flatnonzero(sense.frozen).tolist() == [4]
    sense.update(noisy(1, seed=9)[0])
    assert not sense.frozen.any()
