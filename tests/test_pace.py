"""Clocks and scenes that go at another pace than the machine's."""

from __future__ import annotations

import time

import pytest

from preshape.hal.clock import MonotonicClock
from preshape.sim_backend.real_pace import SLIP_NS, YIELD_S, RealPace
from preshape.sim_backend.simulation import STEP_NS
from preshape.tools.command_hand_bus import Options
from preshape.tools.configuration_error import ConfigurationError


@pytest.mark.parametrize("pace", [0.05, 0.5, 1.0])
def test_so_many_seconds_pass_in_each_of_the_machines(pace: float) -> None:
    clock, wall_ns, began_ns = MonotonicClock(pace), time.monotonic_ns(), MonotonicClock(pace).now_ns()
    clock.sleep_until_ns(began_ns + round(0.02e9 * pace))
    assert clock.now_ns() - began_ns >= 0.02e9 * pace - 1e3
    assert clock.now_ns() - began_ns <= (time.monotonic_ns() - wall_ns) * pace + 1e3


def test_two_clocks_of_one_pace_show_one_time() -> None:
    first = MonotonicClock(0.25).now_ns()
    second = MonotonicClock(0.25).now_ns()
    third = MonotonicClock(0.25).now_ns()
    assert first <= second <= third <= MonotonicClock(0.25).now_ns()


def test_a_deadline_that_has_passed_is_not_waited_for() -> None:
    clock = MonotonicClock(1e-6)
    began_s = time.monotonic()
    clock.sleep_until_ns(clock.now_ns() - 1)
    assert time.monotonic() - began_s < 1.0


def test_a_scene_in_slow_motion_takes_its_steps_as_much_more_slowly() -> None:
    pace = RealPace(0.1)
    began_s = time.monotonic()
    pace.begin(0)
    for step in range(1, 6):
        pace.wait(step * STEP_NS)
    assert time.monotonic() - began_s >= 5 * STEP_NS * 1e-9 / 0.1


def test_a_late_scene_leaves_the_processor_to_others_and_stands_still_for_what_it_cannot_catch_up() -> None:
    pace = RealPace()
    pace.begin(0)
    time.sleep(2e-9 * STEP_NS)
    began_s = time.monotonic()
    pace.wait(0)
    assert time.monotonic() - began_s >= YIELD_S
    time.sleep(2e-9 * SLIP_NS)
    pace.wait(STEP_NS)
    assert pace.slips >= 1 and pace.slipped_ns > SLIP_NS


@pytest.mark.parametrize("pace", [0.0, -1.0])
def test_a_pace_that_stands_still_is_refused(pace: float) -> None:
    with pytest.raises(ValueError, match="pace: got"):
        MonotonicClock(pace)
    with pytest.raises(ConfigurationError, match="--pace: got"):
        Options(pace=pace)
