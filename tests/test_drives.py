"""Laws of the drives' targets: linear between commands, and what becomes of them when a command is missing."""

from __future__ import annotations

import numpy as np
import pytest

from preshape.hal.layout import LAYOUT
from preshape.sim_backend.bare_robot import BareRobot

ARM, FINGER = LAYOUT.arm("right").start, LAYOUT.hand("right").start
PERIOD_S, STEPS = 0.002, 2
TRAVEL = 0.001
"""What every command is ahead of the one before, rad."""


def targets(missing: set[int], commands: int = 12) -> np.ndarray:
    """Return the arm's and the finger's target (steps, 2) after each step, from where they started, in travels."""
    robot = BareRobot(0)
    start = robot.position.copy()
    seen = []
    for number in range(1, commands + 1):
        if number not in missing:
            robot.drives.follow(start + number * TRAVEL, LAYOUT.torque, PERIOD_S)
        for _ in range(STEPS):
            robot.step()
            seen.append((robot.drives.targets - start)[[ARM, FINGER]] / TRAVEL)
    return np.array(seen)


def test_targets_run_linearly_from_command_to_command() -> None:
    steps = 0.5 * np.arange(1, 25)
    np.testing.assert_allclose(targets(set()), np.column_stack([steps, steps]), atol=1e-9)


@pytest.mark.parametrize("lost", [3, 7])
def test_an_arm_coasts_over_one_lost_command_and_a_finger_waits_for_the_next(lost: int) -> None:
    arm, finger = targets({lost}).T
    np.testing.assert_allclose(arm, 0.5 * np.arange(1, 25), atol=1e-9)
    during = slice(STEPS * (lost - 1), STEPS * lost)
    np.testing.assert_allclose(finger[during], lost - 1, atol=1e-9)
    np.testing.assert_allclose(finger[STEPS * (lost + 1) - 1], lost + 1, atol=1e-9)


def test_an_arm_whose_commands_end_rests_one_period_further_on() -> None:
    arm, finger = targets(set(range(5, 13))).T
    np.testing.assert_allclose(arm[8:10], [4.5, 5.0], atol=1e-9)
    np.testing.assert_allclose(arm[10:], 5.0, atol=1e-9)
    np.testing.assert_allclose(finger[8:], 4.0, atol=1e-9)


def test_what_is_held_neither_moves_nor_coasts() -> None:
    robot = BareRobot(0)
    start = robot.position.copy()
    robot.drives.follow(start + TRAVEL, LAYOUT.torque, PERIOD_S)
    robot.step()
    robot.drives.hold(start, LAYOUT.torque)
    robot.step(6)
    np.testing.assert_array_equal(robot.drives.targets, start)
