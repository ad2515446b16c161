"""Slip and lasting values from scripted contacts."""

from __future__ import annotations

import numpy as np
import pytest

from preshape.sim_backend.contact_scan import LINKS
from preshape.sim_backend.hold_slip import HoldSlip, Sustained


def slid(velocities: dict[int, list[float]], loads: dict[int, float], steps: int, right: bool, left: bool) -> HoldSlip:
    slip = HoldSlip(0.001)
    load, slide = np.zeros(LINKS), np.zeros((LINKS, 3))
    for link, value in loads.items():
        load[link] = value
    for step in range(steps):
        for link, speeds in velocities.items():
            slide[link, 0] = speeds[step % len(speeds)]
        slip.update(load, slide, right, left)
    return slip


def test_slip_is_the_load_weighted_mean_of_sliding() -> None:
    slip = slid({3: [0.01]}, {3: 2.0, 7: 6.0}, 500, True, False)
    assert 1e3 * slip.slip_m == pytest.approx(5.0 / 4, abs=0.1)
    assert 1e3 * slip.path_m.max() == pytest.approx(5.0, abs=0.21)


def test_sliding_back_and_forth_within_the_dead_band_is_no_slip_and_beyond_it_is() -> None:
    shake = [0.05] * 3 + [-0.05] * 3
    assert slid({3: shake}, {3: 2.0}, 6000, True, False).slip_m == 0.0
    strong = [0.05] * 20 + [-0.05] * 20
    assert slid({3: strong}, {3: 2.0}, 400, True, False).slip_m == pytest.approx(0.4 * 0.05, rel=0.15)


def test_only_the_holding_hand_slips() -> None:
    right, left = 3, LINKS // 2 + 3
    speeds, loads = {right: [0.01]}, {right: 2.0, left: 2.0}
    assert slid(speeds, loads, 500, False, True).slip_m == 0.0
    assert 1e3 * slid(speeds, loads, 500, True, True).slip_m == pytest.approx(2.5, abs=0.2)


def test_a_part_that_does_not_touch_does_not_slide() -> None:
    assert slid({3: [0.01]}, {7: 2.0}, 500, True, False).slip_m == 0.0


def test_sustained_is_the_largest_sliding_minimum() -> None:
    rng = np.random.default_rng(0)
    values = rng.uniform(0.0, 1.0, (300, 4))
    watch = Sustained(np.ones(4), 3)
    for row in values:
        watch.update(row)
    windows = np.lib.stride_tricks.sliding_window_view(values, 3, axis=0)
    assert np.allclose(watch.worst, windows.min(axis=2).max(axis=0))
    assert np.allclose(watch.peak, values.max(axis=0))
