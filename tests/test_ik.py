"""Laws of the whole-body IK of both arms."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from preshape.control.ik import ARMS_DOF, ArmIk, IkConfig, IkStatus
from preshape.hal.description import ARM_BASE
from preshape.hal.layout import LAYOUT, SIDES
from preshape.hal.transform import exp_so3, transform
from preshape.planner.arm_ik import solve_palm
from preshape.planner.arm_kinematics import palm_pose

DT = 0.002
BASES = {side: transform(ARM_BASE[side]) for side in SIDES}
RIGHT = np.array([-1.372, -0.859, 1.185, -2.359, 0.814, 1.836, -0.890])
HOME = np.concatenate([RIGHT, RIGHT * [-1, 1, -1, 1, -1, 1, -1]])
VELOCITY = np.concatenate([LAYOUT.velocity[LAYOUT.arm(side)] for side in SIDES])


def _palms(q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return palm_pose("right", BASES["right"], q[:7]), palm_pose("left", BASES["left"], q[7:])


def _moved(X: np.ndarray, p: tuple[float, float, float], w: tuple[float, float, float]) -> np.ndarray:
    return transform(X[:3, 3] + p, exp_so3(w) @ X[:3, :3])


@pytest.fixture
def ik() -> ArmIk:
    solver = ArmIk(BASES)
    solver.set_nominal(HOME)
    return solver


def test_stays_where_the_palms_already_are(ik: ArmIk) -> None:
    step = ik.solve(HOME, *_palms(HOME), DT)
    assert step.status is IkStatus.REACHED
    assert np.allclose(step.q, HOME, atol=1e-9)


def test_both_palms_reach_their_targets_within_joint_speed_and_position_limits(ik: ArmIk) -> None:
    right, left = _palms(HOME)
    targets = _moved(right, (0.08, 0.05, -0.06), (0.2, -0.3, 0.4)), _moved(left, (0.05, 0.1, 0.1), (-0.3, 0.2, 0.5))
    q = HOME
    for _ in range(1000):
        step = ik.solve(q, *targets, DT)
        assert (np.abs(step.q - q) <= VELOCITY * DT + 1e-9).all()
        assert (step.q >= ik.lower).all() and (step.q <= ik.upper).all()
        q = step.q
    assert step.status is IkStatus.REACHED
    for X, target in zip(_palms(q), targets, strict=True):
        assert np.allclose(X, target, atol=1e-5)


def test_reported_errors_are_those_of_the_returned_posture(ik: ArmIk) -> None:
    right, left = _palms(HOME)
    targets = _moved(right, (0.3, 0.0, 0.0), (0.5, 0.0, 0.0)), left
    step = ik.solve(HOME, *targets, DT)
    X = _palms(step.q)[0]
    angle = np.arccos(0.5 * (np.trace(X[:3, :3].T @ targets[0][:3, :3]) - 1.0))
    assert step.status is IkStatus.MOVING
    assert step.position_error[0] == pytest.approx(np.linalg.norm(X[:3, 3] - targets[0][:3, 3]))
    assert step.rotation_error[0] == pytest.approx(angle, rel=1e-9)


def test_a_command_outside_its_limits_is_clamped_and_never_makes_the_program_infeasible(ik: ArmIk) -> None:
    rng = np.random.default_rng(0)
    for _ in range(200):
        q = rng.uniform(ik.lower - 1.0, ik.upper + 1.0)
        step = ik.solve(q, *_palms(HOME), DT)
        assert step.status in (IkStatus.MOVING, IkStatus.REACHED)
        assert (step.q >= ik.lower).all() and (step.q <= ik.upper).all()


def test_a_target_out_of_reach_leaves_the_other_arm_undisturbed(ik: ArmIk) -> None:
    left = _palms(HOME)[1]
    q = HOME
    for _ in range(1000):
        step = ik.solve(q, transform((3.0, 0.0, 0.5)), left, DT)
        q = step.q
    assert step.status is IkStatus.MOVING and step.position_error[0] > 1.0
    assert step.position_error[1] < 1e-4


def test_forearms_keep_apart_when_the_targets_cross(ik: ArmIk) -> None:
    right, left = _palms(HOME)
    q = HOME
    for k in range(1500):
        shift = 0.0004 * k
        q = ik.solve(q, _moved(right, (0, shift, 0), (0, 0, 0)), _moved(left, (0, -shift, 0), (0, 0, 0)), DT).q
    robot: Any = ik._robot  # pyright: ignore[reportPrivateUsage]
    robot.update_kinematics()
    gap = min(pair.min_distance for pair in robot.distances())
    assert gap > 0.5 * ik.config.forearm_gap


def test_the_redundancy_drifts_to_the_nominal_posture_slowly_while_the_palms_stay(ik: ArmIk) -> None:
    palms = _palms(HOME)
    solutions = solve_palm("right", BASES["right"], palms[0])
    travel = np.abs(solutions - RIGHT).max(axis=1)
    nominal = np.concatenate([solutions[np.argmin(np.abs(travel - 0.4))], HOME[7:]])
    ik.set_nominal(nominal)
    q, fastest = HOME, 0.0
    for _ in range(3000):
        step = ik.solve(q, *palms, DT)
        fastest = max(fastest, float(np.abs(step.q - q).max() / DT))
        q = step.q
    assert max(step.position_error) < 1e-4
    assert np.abs(nominal - HOME).max() > 0.3
    assert np.abs(q - nominal).max() < 0.02
    assert fastest <= 2.0 * ik.config.posture_speed


def test_the_same_questions_give_the_same_answers_bit_for_bit() -> None:
    answers = []
    for _ in range(2):
        solver, q = ArmIk(BASES), HOME
        right, left = _palms(HOME)
        for k in range(200):
            q = solver.solve(q, _moved(right, (0, 0, 1e-3 * k), (0, 0, 0)), left, DT).q
        answers.append(q.tobytes())
    assert answers[0] == answers[1]


def test_a_target_that_is_not_finite_is_named_and_moves_nothing(ik: ArmIk) -> None:
    right, left = _palms(HOME)
    right[0, 3] = np.nan
    step = ik.solve(HOME, right, left, DT)
    assert step.status is IkStatus.BAD_TARGET and np.array_equal(step.q, HOME)


def test_an_infeasible_program_is_a_status_and_any_other_error_is_not_hidden(
    ik: ArmIk, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Refusing:
        """Solves nothing: raises what it is given."""

        def __init__(self, message: str) -> None:
            self.message, self.dt = message, 0.0

        def solve(self, apply: bool) -> None:
            raise RuntimeError(self.message)

    monkeypatch.setattr(ik, "_solver", Refusing("QPError: infeasible"))
    step = ik.solve(HOME, *_palms(HOME), DT)
    assert step.status is IkStatus.INFEASIBLE and np.array_equal(step.q, HOME)
    monkeypatch.setattr(ik, "_solver", Refusing("something else"))
    with pytest.raises(RuntimeError, match="something else"):
        ik.solve(HOME, *_palms(HOME), DT)


def test_mistakes_of_the_caller_are_refused(ik: ArmIk) -> None:
    with pytest.raises(ValueError, match="shape"):
        ik.solve(np.zeros(ARMS_DOF - 1), *_palms(HOME), DT)
    with pytest.raises(ValueError, match="dt"):
        ik.solve(HOME, *_palms(HOME), 0.0)


def test_settings_are_used() -> None:
    slow = ArmIk(BASES, IkConfig(speed_ratio=0.1))
    step = slow.solve(HOME, transform((3.0, 0.0, 0.5)), _palms(HOME)[1], DT)
    assert (np.abs(step.q - HOME) <= 0.1 * VELOCITY * DT + 1e-9).all()
