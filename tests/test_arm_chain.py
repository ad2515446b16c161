"""Laws of arm postures through a series of palm poses."""

from __future__ import annotations

import numpy as np
import pytest

from preshape.hal.layout import LAYOUT, SIDES, Side
from preshape.hal.transform import Matrix, exp_so3, transform
from preshape.planner.arm_chain import ChainQuery, posture_chain
from preshape.planner.arm_kinematics import palm_pose
from preshape.planner.arm_reach import scores
from preshape.sim_backend.scenario import Scenario
from preshape.sim_backend.scene import workcell

CELL = workcell(Scenario(name="cell"))
QUERY = ChainQuery()


def palm_course(side: Side, seed: int, count: int = 5) -> Matrix:
    """Return palm poses (count, 4, 4) that drift from where an easy posture has the palm, all within reach."""
    rng = np.random.default_rng(seed)
    arm = LAYOUT.arm(side)
    middle = 0.5 * (LAYOUT.lower[arm] + LAYOUT.upper[arm])
    X = palm_pose(side, CELL.X_world_base[side], middle + rng.uniform(-0.3, 0.3, 7))
    step = transform(rng.uniform(-0.01, 0.01, 3), exp_so3(rng.uniform(-0.05, 0.05, 3)))
    poses = [X]
    for _ in range(count - 1):
        poses.append(poses[-1] @ step)
    return np.array(poses)


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("seed", range(6))
def test_postures_reach_their_poses_in_small_steps_away_from_the_limits(side: Side, seed: int) -> None:
    poses = palm_course(side, seed)
    chain = posture_chain(side, CELL.X_world_base[side], poses)
    assert chain is not None and chain.shape == (len(poses), 7)
    for q, X in zip(chain, poses, strict=True):
        np.testing.assert_allclose(palm_pose(side, CELL.X_world_base[side], q), X, atol=1e-6)
    assert np.abs(np.diff(chain, axis=0)).max() <= QUERY.largest_step_rad
    assert scores(side, chain).min() >= QUERY.least_score


@pytest.mark.parametrize("side", SIDES)
def test_a_pose_out_of_reach_anywhere_in_the_course_leaves_no_chain(side: Side) -> None:
    for number in range(3):
        poses = palm_course(side, 1, 3)
        poses[number, :3, 3] += (0.0, 0.0, 3.0)
        assert posture_chain(side, CELL.X_world_base[side], poses) is None


def test_a_jump_beyond_the_largest_step_leaves_no_chain() -> None:
    poses = palm_course("right", 2, 2)
    assert posture_chain("right", CELL.X_world_base["right"], poses, query=ChainQuery(largest_step_rad=1e-6)) is None


def test_every_posture_is_asked_for_by_its_pose_and_none_that_is_refused_is_taken() -> None:
    poses = palm_course("right", 3)
    base = CELL.X_world_base["right"]
    free = posture_chain("right", base, poses)
    assert free is not None
    asked: set[int] = set()
    bound = float(free[2, 6])

    def is_free(number: int, q: Matrix) -> bool:
        asked.add(number)
        return number != 2 or q[6] < bound - 0.05

    chain = posture_chain("right", base, poses, is_free=is_free)
    assert asked == set(range(len(poses)))
    assert chain is None or chain[2, 6] < bound - 0.05
    assert posture_chain("right", base, poses, is_free=lambda number, q: number != 2) is None


def test_the_first_posture_is_drawn_towards_a_near_one() -> None:
    poses = palm_course("right", 4, 2)
    base = CELL.X_world_base["right"]
    free = posture_chain("right", base, poses)
    assert free is not None
    near = free[0].copy()
    near[6] += 1.0
    drawn = posture_chain("right", base, poses, near=near, query=ChainQuery(limit_weight=0.0))
    plain = posture_chain("right", base, poses, query=ChainQuery(limit_weight=0.0))
    assert drawn is not None and plain is not None
    assert np.abs(drawn[0] - near).max() <= np.abs(plain[0] - near).max() + 1e-12


def test_the_same_course_gives_the_same_chain() -> None:
    poses = palm_course("left", 5)
    first, second = (posture_chain("left", CELL.X_world_base["left"], poses) for _ in range(2))
    assert first is not None and second is not None
    np.testing.assert_array_equal(first, second)
